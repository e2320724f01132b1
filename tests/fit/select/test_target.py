"""The target beside a residual against the same values written out over all pairs."""

from __future__ import annotations

import pytest
import torch

from spmm_torch.fit.select.target import residual_weight, target_beside_residual
from tests.fit.select.product_cases import case, chosen, expand, mean_weights


@pytest.mark.parametrize("weight", [0.0, 0.4, 1.0])
def test_target_equals_values_minus_residual(weight: float) -> None:
    atoms, values, products = case(1)
    fit = chosen(products)
    residual = (values - expand(fit, atoms)).mean(0)
    direct = values - weight * residual
    target = target_beside_residual(products, mean_weights(fit), weight)
    expected = torch.einsum("jd,ndc->njc", atoms, direct)
    assert torch.allclose(target.correlation, expected, atol=1e-4)
    assert torch.allclose(target.energy.sum(1).float(), direct.square().sum((1, 2)), rtol=1e-3)


def test_weight_of_the_residual_follows_the_errors() -> None:
    assert residual_weight(1.0, 0.0, 1000) == pytest.approx(0.5, abs=1e-3)
    assert residual_weight(1.0, 0.99, 1000) > 0.98
    assert residual_weight(1.0, 1.0, 1) == 0.0
    assert residual_weight(0.0, 0.0, 10) == 0.0
