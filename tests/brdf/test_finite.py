"""Values and gradients are finite everywhere, and values are not negative."""

from __future__ import annotations

import math

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import Tensor

from spmm_torch.brdf import BRDF
from tests.brdf.brdf_cases import ALL_MODELS, DTYPES, corners, direction

COSINES = st.one_of(
    st.sampled_from([0.0, 1e-8, -1e-8, 1e-4, 1e-3, -1e-3, 0.5, -0.5, 1.0, -1.0]),
    st.floats(-1.0, 1.0),
)
AZIMUTHS = st.one_of(
    st.sampled_from([0.0, math.pi / 2.0, math.pi, 1e-7]), st.floats(0.0, 2.0 * math.pi)
)
# Pairs that make zero half vectors, equal directions, mirror pairs and everything else.
RELATIONS = st.sampled_from(["free", "opposite", "same", "mirror"])


@st.composite
def pairs(draw: st.DrawFn) -> tuple[list[float], list[float]]:
    """One (wi, wo)."""

    def one() -> Tensor:
        cosine = torch.tensor(draw(COSINES), dtype=torch.float64)
        return direction(cosine, torch.tensor(draw(AZIMUTHS), dtype=torch.float64))

    wi, relation = one(), draw(RELATIONS)
    wo = {
        "free": one,
        "opposite": lambda: -wi,
        "same": lambda: wi,
        "mirror": lambda: wi * torch.tensor([-1.0, -1.0, 1.0]),
    }[relation]()
    return wi.tolist(), wo.tolist()


def check(model: BRDF, dtype: torch.dtype, wi: Tensor, wo: Tensor) -> None:
    """Evaluates at every corner of the box and asserts on values `[N, Q]` and gradients."""
    kappa = corners(model, dtype).requires_grad_()
    wi = wi.to(dtype)[:, None].clone().requires_grad_()
    wo = wo.to(dtype)[:, None].clone().requires_grad_()
    value = model.eval(kappa, wi, wo)
    assert value.dtype == dtype
    assert bool(torch.isfinite(value).all())
    assert bool((value >= 0.0).all())
    hidden = (wi[..., 2] <= 0.0) | (wo[..., 2] <= 0.0)
    assert bool((value[hidden.expand(value.shape)] == 0.0).all())
    if value.requires_grad:
        inputs = (kappa, wi, wo)
        for gradient in torch.autograd.grad(value.sum(), inputs, allow_unused=True):
            assert gradient is None or bool(torch.isfinite(gradient).all())


@pytest.mark.parametrize("dtype", DTYPES, ids=str)
@pytest.mark.parametrize("model", ALL_MODELS)
@settings(max_examples=25)
@given(drawn=st.lists(pairs(), min_size=1, max_size=20))
def test_drawn_directions(
    model: BRDF, dtype: torch.dtype, drawn: list[tuple[list[float], list[float]]]
) -> None:
    wi, wo = torch.tensor(drawn, dtype=torch.float64).unbind(1)
    check(model, dtype, wi, wo)


@pytest.mark.parametrize("dtype", DTYPES, ids=str)
@pytest.mark.parametrize("model", ALL_MODELS)
def test_every_pair_of_special_directions(model: BRDF, dtype: torch.dtype) -> None:
    cosine = torch.tensor([1.0, 0.5, 1e-3, 1e-4, 1e-8, 0.0, -1e-8, -1e-3, -0.5, -1.0])
    azimuth = torch.tensor([0.0, 1e-7, 1.0, math.pi / 2.0, math.pi, math.pi + 1e-7])
    special = direction(cosine.double()[:, None], azimuth.double()).reshape(-1, 3)
    wi = special.repeat(len(special), 1)
    wo = special.repeat_interleave(len(special), dim=0)
    check(model, dtype, wi, wo)


@pytest.mark.parametrize("dtype", DTYPES, ids=str)
@pytest.mark.parametrize("model", ALL_MODELS)
def test_exactly_opposite_directions(model: BRDF, dtype: torch.dtype) -> None:
    cosine = torch.linspace(-1.0, 1.0, 41, dtype=torch.float64)
    wi = direction(cosine, torch.linspace(0.0, 6.0, 41, dtype=torch.float64))
    check(model, dtype, wi, -wi)
