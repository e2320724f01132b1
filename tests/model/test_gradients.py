"""Gradients of a model: right against differences, and finite where light and view graze."""

from __future__ import annotations

import pytest
import torch
from torch import Tensor
from torch.func import functional_call

from spmm_torch import SPMM
from spmm_torch.brdf import MODEL_NAMES
from spmm_torch.geometry.directions import direction_from_angles, ring_directions
from tests.planted.directions import random_directions
from tests.planted.models import planted_relief, uneven_model, with_components, with_relief

LIGHT = ring_directions(((0.0, 1), (35.0, 6), (70.0, 10)))
PARAMETERS = ("weight", "kappa", "normal", "angle", "relief.height")
QUERIES = ("uv", "wi", "wo")


def build() -> SPMM:
    """Two texels by two with lobes of all BRDFs, both kinds of residual, and a relief."""
    model = uneven_model((len(MODEL_NAMES), 3, 4, 2), 2, LIGHT, LIGHT, precision=torch.float32)
    model = with_components(model, beside=True, dtype=torch.float32)
    return with_relief(model, planted_relief(2, 2, 0.2)).double()


@pytest.fixture(scope="module")
def model() -> SPMM:
    return build()


def given(count: int, grazes: bool) -> dict[str, Tensor]:
    uv = 0.9 * torch.rand(count, 2, generator=torch.Generator().manual_seed(4)).double()
    wi, wo = (random_directions(count, seed, max_theta=1.1) for seed in (5, 6))
    if grazes:  # light, view, or both
        low = torch.linspace(1.4, 1.55, count).double()
        azimuth = 0.5 + torch.arange(count).double()  # 0 is a kink of the residual
        low, across = (direction_from_angles(low, turn * azimuth) for turn in (1.0, 2.0))
        third = torch.arange(count)[:, None] % 3
        wi, wo = torch.where(third < 2, low, wi), torch.where(third > 0, across, wo)
    return {"uv": uv, "wi": wi, "wo": wo}


@pytest.mark.parametrize("grazes", [False, True], ids=["steep", "grazing"])
@pytest.mark.parametrize("padded", [False, True], ids=["ragged", "padded"])
@pytest.mark.parametrize("name", [*PARAMETERS, *QUERIES])
def test_against_differences(model: SPMM, name: str, padded: bool, grazes: bool) -> None:
    queries = given(6, grazes)
    values = {**queries, **{key: model.get_parameter(key).detach() for key in PARAMETERS}}
    point = values[name].clone().requires_grad_()
    model.checks_queries = False  # differences leave the sphere

    def value(moved: Tensor) -> Tensor:
        held = {**values, name: moved}
        asked = {key: held[key] for key in QUERIES} | {"padded": padded}
        return functional_call(model, {key: held[key] for key in PARAMETERS}, (), asked)

    assert torch.autograd.gradcheck(value, (point,), fast_mode=True, atol=1e-6)


def grazing() -> tuple[Tensor, Tensor]:
    """wi and wo `[Q, 3]` float32 that are on the horizon, near it, upright, equal and opposite."""
    theta = torch.tensor([0.0, 1e-4, 1.5, 1.57, 1.5707, 0.5 * torch.pi, 1.5709])
    theta_i, theta_o, phi = torch.meshgrid(
        theta, theta, torch.tensor([0.0, 3.1415927]), indexing="ij"
    )
    wi = direction_from_angles(theta_i.flatten(), torch.zeros(theta_i.numel()))
    wo = direction_from_angles(theta_o.flatten(), phi.flatten())
    return wi, wo


@pytest.mark.parametrize("padded", [False, True], ids=["ragged", "padded"])
def test_finite_at_grazing_angles(padded: bool) -> None:
    model = build().float()
    trained = {n: p for n, p in model.named_parameters() if p.is_floating_point()}
    for parameter in trained.values():
        parameter.requires_grad_()
    wi, wo = (part.requires_grad_() for part in grazing())
    uv = torch.full((len(wi), 2), 0.3, requires_grad=True)
    value = model(uv, wi, wo, padded=padded)
    assert value.isfinite().all()
    value.sum().backward()
    for name, part in (("uv", uv), ("wi", wi), ("wo", wo), *trained.items()):
        assert part.grad is not None and part.grad.isfinite().all(), name
