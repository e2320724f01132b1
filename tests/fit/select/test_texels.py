"""Dictionary space against the same sums written out over all pairs."""

from __future__ import annotations

import pytest
import torch

from spmm_torch.config.fit import SelectConfig, StagewiseConfig
from spmm_torch.fit.select.target import target_beside_residual
from spmm_torch.fit.select.texels import refit, select
from tests.fit.select.product_cases import (
    TEXELS,
    case,
    chosen,
    errors,
    expand,
    mean_weights,
)


@pytest.mark.parametrize("method", ["corrective", "stagewise"])
def test_errors_equal_the_direct_sums(method: str) -> None:
    atoms, values, products = case()
    fit = chosen(products, method)
    left = values - expand(fit, atoms)
    error, taken = errors(products, fit)
    assert torch.allclose(error.float(), left.square().sum((1, 2)), rtol=1e-4)
    with_residual = (left - left.mean(0)).square().sum()
    assert float(error.sum() - taken) == pytest.approx(float(with_residual), rel=1e-3)


def test_alternation_around_the_mean_never_leaves_more_than_the_mean() -> None:
    _, _, products = case(2)
    target = target_beside_residual(products, None, 1.0)
    fit = select(products, target, SelectConfig(), StagewiseConfig())
    of_mean = float(products.energy.sum() - TEXELS * products.mean_energy.sum())
    last = of_mean
    for _ in range(4):
        error, taken = errors(products, fit)
        now = float(error.sum() - taken)
        assert now <= last * (1.0 + 1e-5)
        last = now
        fit = refit(products, fit, target_beside_residual(products, mean_weights(fit), 1.0))


@pytest.mark.parametrize("method", ["corrective", "stagewise"])
def test_lobe_limit_holds_and_weights_are_not_negative(method: str) -> None:
    _, _, products = case(3)
    fit = chosen(products, method, max_lobes=2)
    assert int((fit.index >= 0).sum(1).max()) <= 2
    assert (fit.weights >= 0.0).all()
