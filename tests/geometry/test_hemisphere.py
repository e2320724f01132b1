"""The interpolation of values on a hemisphere of measured directions."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
import torch
from torch import Tensor

from spmm_torch.geometry import hemisphere
from spmm_torch.geometry.directions import UBO2014_RINGS, direction_from_angles, ring_directions
from spmm_torch.geometry.hemisphere import MAP_SIZE, HemisphereInterpolation
from tests.largest_tensor import LargestTensor
from tests.planted.directions import random_directions


def vector(*values: float) -> Tensor:
    return torch.tensor(values, dtype=torch.float64)


def one_ring(theta: float, count: int) -> Tensor:
    phi = torch.arange(count, dtype=torch.float64) * (2.0 * math.pi / count)
    return direction_from_angles(torch.full_like(phi, math.radians(theta)), phi)


def arc(count: int) -> Tensor:
    """Directions on one great circle through z."""
    theta = torch.linspace(-1.0, 1.0, count, dtype=torch.float64)
    return direction_from_angles(theta, torch.full_like(theta, 0.3))


SETS = {
    "ubo2003": ring_directions().double(),
    "ubo2014": ring_directions(UBO2014_RINGS).double(),
    "random": random_directions(40, seed=8, max_theta=1.3),
    "to the horizon": ring_directions(((0.0, 1), (45.0, 8), (90.0, 12))).double(),
    "one": random_directions(1, seed=9),
    "one, tilted": one_ring(80.0, 1),
    "two": random_directions(2, seed=10),
    "two, tilted": one_ring(80.0, 2),
    "three": random_directions(3, seed=11),
    "three, in line": arc(3),
    "four": random_directions(4, seed=12),
    "arc": arc(9),
    "one ring": one_ring(45.0, 12),
    "one low ring": one_ring(85.0, 3),
    "horizon": one_ring(90.0, 8),
    "doubled": random_directions(10, seed=13).repeat(2, 1),
}
ALL_SETS = [
    pytest.param(directions.to(dtype), id=f"{name}-{str(dtype)[6:]}")
    for name, directions in SETS.items()
    for dtype in (torch.float32, torch.float64)
]
FULL_SETS = [pytest.param(SETS[name], id=name) for name in ("ubo2003", "ubo2014", "random")]


def interpolate(directions: Tensor, values: Tensor, w: Tensor) -> Tensor:
    index, weight = HemisphereInterpolation.build(directions).weights(w)
    return (values[index] * weight).sum(dim=-1)


@pytest.mark.parametrize("directions", ALL_SETS)
def test_samples_return_their_own_value(directions: Tensor) -> None:
    generator = torch.Generator().manual_seed(14)
    values = torch.rand(len(directions), generator=generator, dtype=directions.dtype)
    if len(torch.unique(directions, dim=0)) < len(directions):
        values = values[: len(values) // 2].repeat(2)
    found = interpolate(directions, values, directions)
    torch.testing.assert_close(
        found, values, rtol=0.0, atol=1e-4 if values.element_size() < 8 else 1e-9
    )


@pytest.mark.parametrize("directions", ALL_SETS)
def test_weights_are_a_partition_of_unity_everywhere(directions: Tensor) -> None:
    """Below the lowest ring and over the horizon's edge too."""
    horizon = one_ring(90.0, 64)
    w = torch.cat((random_directions(500, seed=15), horizon)).to(directions.dtype)
    index, weight = HemisphereInterpolation.build(directions).weights(w)
    assert bool(torch.isfinite(weight).all())
    assert bool((weight >= 0.0).all())
    torch.testing.assert_close(weight.sum(dim=-1), torch.ones(len(w), dtype=weight.dtype))
    assert int(index.min()) >= 0 and int(index.max()) < len(directions)
    assert weight.dtype == directions.dtype


@pytest.mark.parametrize("directions", FULL_SETS)
def test_linear_functions_are_reproduced_up_to_the_chord(directions: Tensor) -> None:
    """The interpolated direction points where the query does, and is a little shorter."""
    w = random_directions(300, seed=16, max_theta=0.8)
    index, weight = HemisphereInterpolation.build(directions).weights(w)
    point = (directions[index] * weight[..., None]).sum(dim=-2)  # [300, 3]
    length = point.norm(dim=-1, keepdim=True)
    torch.testing.assert_close(point / length, w)
    assert bool((length <= 1.0 + 1e-12).all())
    assert bool((length > 0.85).all())


@pytest.mark.parametrize("directions", FULL_SETS[:2])
def test_interpolation_is_continuous(directions: Tensor) -> None:
    """Walks across many triangles, and out below the lowest ring, in small steps."""
    theta = torch.linspace(0.0, math.pi / 2.0, 4000, dtype=torch.float64)
    w = direction_from_angles(theta, 3.0 * theta)
    values = torch.rand(
        len(directions), generator=torch.Generator().manual_seed(17), dtype=torch.float64
    )
    assert float(interpolate(directions, values, w).diff().abs().max()) < 0.02


@pytest.mark.parametrize("directions", FULL_SETS[:2])
def test_only_corners_near_the_query_count(directions: Tensor) -> None:
    """Below the lowest ring too: no weight on a direction farther than two neighbours."""
    w = random_directions(500, seed=18)
    index, weight = HemisphereInterpolation.build(directions).weights(w)
    cosine = (directions[index] * w[:, None]).sum(dim=-1)
    far = torch.arccos(cosine.clamp(-1.0, 1.0)) > math.radians(31.0)
    assert float(weight[far].sum()) == 0.0


def test_few_directions_give_the_nearest() -> None:
    directions = torch.cat((one_ring(80.0, 2), vector(0.0, 0.0, 1.0)[None]))[:2]
    w = direction_from_angles(vector(1.2, 1.2, 0.3), vector(0.2, 3.0, 0.0))
    index, weight = HemisphereInterpolation.build(directions).weights(w)
    for column, expected in enumerate((0, 1, 0)):
        share = weight[column][index[column] == expected].sum()
        assert float(share) == pytest.approx(1.0)


def test_interpolation_is_batched_and_keeps_dtype() -> None:
    interpolation = HemisphereInterpolation.build(ring_directions())
    w = random_directions(6, seed=19).float().reshape(2, 3, 3)
    index, weight = interpolation.weights(w)
    assert index.shape == weight.shape == (2, 3, 3)
    assert weight.dtype == torch.float32
    moved = interpolation.to("cpu")
    assert torch.equal(moved.weights(w)[1], weight)


@pytest.mark.parametrize("known", [random_directions(300, seed=4), arc(300)])
def test_lost_queries_are_compared_in_parts(known: Tensor, monkeypatch: pytest.MonkeyPatch) -> None:
    """Where no cell of the map holds them, be there cells or none."""
    interpolation = HemisphereInterpolation.build(known)
    interpolation = replace(interpolation, candidates=interpolation.candidates[:1] * 0 - 1)
    queries = random_directions(500, seed=5)
    whole = interpolation.weights(queries)
    monkeypatch.setattr(hemisphere, "BLOCK_COMPARISONS", 4 * len(known))
    with LargestTensor() as largest:
        parts = interpolation.weights(queries)
    assert largest.numel <= MAP_SIZE**2  # one rank of the map
    for found, expected in zip(parts, whole, strict=True):
        torch.testing.assert_close(found, expected)
