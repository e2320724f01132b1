"""The residual: its storage, and what it is at and between the measured directions."""

from __future__ import annotations

import math

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from torch import Tensor

from spmm_torch.geometry.directions import direction_from_angles, ring_directions
from spmm_torch.model.residual import Residual, decode_residual, encode_residual
from tests.planted.directions import random_directions

LIGHT = ring_directions(((0.0, 1), (40.0, 6), (75.0, 12)))
VIEW = ring_directions(((0.0, 1), (30.0, 5), (60.0, 9)))
CLUSTERS = 3
HALF_ROUNDING = 2.0**-11  # half a unit in the last place of a half, relative


def signed(*shape: int, seed: int = 0) -> Tensor:
    return torch.randn(*shape, generator=torch.Generator().manual_seed(seed))


@pytest.fixture
def residual() -> Residual:
    code, scale = encode_residual(signed(CLUSTERS, len(VIEW), len(LIGHT), 3), torch.float16)
    return Residual(code, scale, LIGHT, VIEW)


@given(st.floats(-35.0, 35.0), st.integers(0, 100))
def test_float16_round_trip_at_any_range(exponent: float, seed: int) -> None:
    """11 bits relative to each value, or a ten-millionth of the cluster's largest."""
    values = 10.0**exponent * signed(2, 5, 4, 3, seed=seed)
    code, scale = encode_residual(values, torch.float16)
    assert code.dtype == torch.float16
    assert scale.shape == (2,)
    assert code.isfinite().all()
    largest = values.abs().flatten(1).amax(1)[:, None, None, None]
    allowed = 1.01 * HALF_ROUNDING * values.abs() + 1e-7 * largest
    assert ((decode_residual(code, scale) - values).abs() <= allowed).all()


def test_clusters_do_not_share_a_scale() -> None:
    values = torch.stack([signed(4, 3), 1e6 * signed(4, 3), 1e-6 * signed(4, 3)])
    decoded = decode_residual(*encode_residual(values, torch.float16))
    torch.testing.assert_close(decoded, values, rtol=HALF_ROUNDING, atol=0.0)


def test_all_zero() -> None:
    code, scale = encode_residual(torch.zeros(2, 4, 3), torch.float16)
    assert scale.isfinite().all()
    assert torch.equal(decode_residual(code, scale), torch.zeros(2, 4, 3))


def test_float32_is_exact() -> None:
    values = torch.stack([signed(4, 3), 1e6 * signed(4, 3)])
    code, scale = encode_residual(values, torch.float32)
    assert code.dtype == torch.float32
    assert torch.equal(decode_residual(code, scale), values)


def test_measured_pairs_return_their_value(residual: Residual) -> None:
    stored = decode_residual(residual.code, residual.scale)  # [K, V, L, C]
    cluster = torch.arange(CLUSTERS)[:, None, None]
    found = residual(cluster, LIGHT[None, None], VIEW[None, :, None])
    torch.testing.assert_close(found, stored, rtol=1e-5, atol=1e-5)


def test_between_stays_within_the_measured_values(residual: Residual) -> None:
    stored = decode_residual(residual.code, residual.scale)
    wi, wo = (random_directions(2000, seed).float() for seed in (1, 2))
    for cluster in range(CLUSTERS):
        found = residual(torch.tensor(cluster), wi, wo)
        assert found.shape == (2000, 3)
        low, high = stored[cluster].amin((0, 1)), stored[cluster].amax((0, 1))
        assert (found <= high.clamp(min=0.0) + 1e-5).all()
        assert (found >= low.clamp(max=0.0) - 1e-5).all()


@pytest.mark.parametrize("moving", ["light", "view"])
def test_continuous(residual: Residual, moving: str) -> None:
    """Along paths from the pole to the horizon, at many azimuths, small steps change little."""
    theta = torch.linspace(0.0, 0.4999 * math.pi, 4001)[:, None]
    phi = torch.linspace(0.0, 2 * math.pi, 25)[None, :]
    path = direction_from_angles(theta.expand(-1, 25), phi.expand(4001, -1))
    fixed = direction_from_angles(torch.tensor(0.7), torch.tensor(1.0)).expand_as(path)
    wi, wo = (path, fixed) if moving == "light" else (fixed, path)
    found = residual(torch.tensor(1), wi, wo)
    # Values of order 1 on cells of 0.3 rad at least: slopes stay below some tens.
    assert (found[1:] - found[:-1]).abs().max() < 0.02
    assert torch.isfinite(found).all()


def test_zero_at_and_under_the_horizon(residual: Residual) -> None:
    up = torch.tensor([0.0, 0.0, 1.0])
    cluster = torch.tensor(0)
    for low in ([1.0, 0.0, 0.0], [0.6, 0.0, -0.8], [0.0, 0.0, -1.0]):
        w = torch.tensor(low)
        assert torch.equal(residual(cluster, w, up), torch.zeros(3))
        assert torch.equal(residual(cluster, up, w), torch.zeros(3))


def test_low_lights_fade_with_their_cosine(residual: Residual) -> None:
    wo, phi = VIEW[3], torch.tensor(0.0)
    ring = residual(torch.tensor(2), LIGHT[7], wo)
    torch.testing.assert_close(LIGHT[7], direction_from_angles(torch.tensor(math.radians(75)), phi))
    for degrees in (76.0, 80.0, 85.0, 89.9):
        theta = torch.tensor(math.radians(degrees))
        found = residual(torch.tensor(2), direction_from_angles(theta, phi), wo)
        fade = math.cos(math.radians(degrees)) / math.cos(math.radians(75.0))
        torch.testing.assert_close(found, fade * ring, rtol=1e-4, atol=1e-5)


def test_lights_measured_on_the_horizon() -> None:
    """Their values are zero by definition, and those beside them are finite."""
    light = torch.cat((LIGHT, torch.tensor([[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]])))
    residual = Residual(torch.ones(1, len(VIEW), len(light), 3), torch.ones(1), light, VIEW)
    cluster = torch.tensor(0)
    assert torch.equal(residual(cluster, light[-1], VIEW[0]), torch.zeros(3))
    torch.testing.assert_close(residual(cluster, light[:-2], VIEW[:1]), torch.ones(len(LIGHT), 3))


def test_one_pair_only() -> None:
    up = torch.tensor([[0.0, 0.0, 1.0]])
    residual = Residual(torch.full((1, 1, 1, 3), 2.0), torch.ones(1), up, up)
    found = residual(torch.tensor(0), random_directions(5, 1).float(), up)
    assert found.shape == (5, 3)
    assert ((found > 0.0) & (found <= 2.0)).all()
    assert torch.equal(residual(torch.tensor(0), up[0], up[0]), torch.full((3,), 2.0))


def test_follows_dtype_of_directions(residual: Residual) -> None:
    found = residual(torch.tensor([0, 2]), LIGHT[:2].double(), VIEW[:2].double())
    assert found.dtype == torch.float64
    single = residual(torch.tensor([0, 2]), LIGHT[:2], VIEW[:2])
    torch.testing.assert_close(found.float(), single, rtol=1e-5, atol=1e-5)


def test_blend_is_the_sum_of_its_clusters(residual: Residual) -> None:
    """Whichever columns name the same cluster, and with shares of 0."""
    generator = torch.Generator().manual_seed(4)
    cluster = torch.cartesian_prod(*[torch.arange(CLUSTERS)] * 4)  # [81, 4]
    share = torch.rand(len(cluster), 4, generator=generator)
    share[::3, 1] = 0.0
    wi, wo = (random_directions(len(cluster), seed).float() for seed in (5, 6))
    each = residual(cluster, wi[:, None], wo[:, None])  # [81, 4, C]
    expected = (each * share[..., None]).sum(dim=1)
    torch.testing.assert_close(residual.blend(cluster, share, wi, wo), expected)
    share.requires_grad_()
    (slope,) = torch.autograd.grad(residual.blend(cluster, share, wi, wo).sum(), share)
    torch.testing.assert_close(slope, each.sum(dim=2))
