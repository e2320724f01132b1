"""The operator of compiled programs against padded tables: values and gradients."""

from __future__ import annotations

import pytest
import torch
from torch import Tensor

from spmm_torch import SPMM
from spmm_torch.geometry.directions import MIRROR, REPEAT, ring_directions, texel_at
from spmm_torch.model import dense, operator
from tests.planted.directions import random_directions
from tests.planted.models import uneven_model, with_components

LIGHT = ring_directions(((0.0, 1), (35.0, 6)))
COUNTS = (0, 1, 9, 2, 4, 3)


def asked(model: SPMM, rule: str) -> list[Tensor]:
    """Texels, their bilinear weights, wi and wo of 30 queries in several copies of the texture."""
    uv = 3.0 * torch.rand(30, 2, generator=torch.Generator().manual_seed(1)).double() - 1.0
    wi, wo = (random_directions(30, seed, max_theta=1.65) for seed in (2, 3))
    return [*texel_at(uv, model.height, model.width, rule), wi, wo]


@pytest.mark.parametrize("residual", [False, True])
@pytest.mark.parametrize("rule", [REPEAT, MIRROR])
def test_values_and_gradients_are_those_of_padded_tables(rule: str, residual: bool) -> None:
    model = uneven_model(COUNTS, 2, LIGHT, LIGHT, precision=torch.float32)
    model = with_components(model, beside=True).double()
    model.wrap = rule
    texel, *moved = asked(model, rule)
    moved = [part.requires_grad_() for part in moved]
    trained = [model.weight, model.kappa, model.normal, model.angle, *moved]
    if residual:
        trained.append(model.residual.code.requires_grad_())
    padded = dense.lobe_sums(model.padded_tables(), model.dictionary, model.weight, texel, *moved)
    if residual:
        parts = model.residual, model.components, model.labels
        padded = padded + dense.residual_sums(*parts, texel, *moved)
    found = operator.values(model, texel[:, 0], *moved, residual=residual)
    torch.testing.assert_close(found, padded, rtol=1e-12, atol=1e-14)
    expected = torch.autograd.grad(padded.square().sum(), trained)
    for one, other in zip(
        torch.autograd.grad(found.square().sum(), trained), expected, strict=True
    ):
        torch.testing.assert_close(one, other, rtol=1e-9, atol=1e-12)


def test_only_what_is_asked_for_has_a_gradient() -> None:
    model = uneven_model(COUNTS, 2, LIGHT, LIGHT).requires_grad_(False)
    texel, *moved = (p.float() if p.is_floating_point() else p for p in asked(model, REPEAT))
    moved[1].requires_grad_()
    found = operator.values(model, texel[:, 0], *moved, residual=True)
    (slope,) = torch.autograd.grad(found.sum(), moved[1])
    assert slope.shape == moved[1].shape and bool(slope.isfinite().all())
    assert model.kappa.grad is None
