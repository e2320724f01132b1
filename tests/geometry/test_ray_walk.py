"""The walk over cells against a fine march, on rough and spiky maps."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates
from torch import Tensor

from spmm_torch.geometry import ray_walk
from spmm_torch.geometry.directions import MIRROR, REPEAT
from spmm_torch.geometry.relief import HeightField
from tests.planted.directions import random_directions

SLOPE = 3.7
# Points of the fine march along each ray.
MARCH = 6000


def rough_map(rows: int, columns: int, amplitude: float, seed: int = 0) -> Tensor:
    """Heights of independent texels, some below the plane."""
    drawn = torch.rand(rows, columns, generator=torch.Generator().manual_seed(seed))
    return amplitude * (drawn.double() - 0.4)


def surface(height: Tensor, at: NDArray[np.float64], rule: str) -> NDArray[np.float64]:
    """Bilinear heights `[...]` at uv `[..., 2]`, by SciPy."""
    rows, columns = height.shape
    place = np.stack(((1.0 - at[..., 1]) * rows - 0.5, at[..., 0] * columns - 0.5))
    mode = {REPEAT: "grid-wrap", MIRROR: "reflect"}[rule]
    return map_coordinates(height.numpy(), place, order=1, mode=mode)


def check_first_hits(field: HeightField, uv: Tensor, wo: Tensor, tolerance: float) -> None:
    """Hits lie on the surface, and no surface lies higher on the way there."""
    rows, columns = field.height.shape
    shift = (wo[:, :2] / wo[:, 2:]).double().numpy() * (1.0, columns / rows)
    at = field.hit(uv, wo).double().numpy()
    start = uv.double().numpy()
    longest = np.abs(shift).argmax(1)[:, None]
    t = (np.take_along_axis(at - start, longest, 1) / np.take_along_axis(shift, longest, 1))[:, 0]
    np.testing.assert_allclose(at, start + t[:, None] * shift, atol=tolerance)
    height = field.height.double()
    np.testing.assert_allclose(surface(height, at, field.rule), t, atol=tolerance)
    high = float(height.max())
    above = t[:, None] + (high - t)[:, None] * np.linspace(0.0, 1.0, MARCH)
    found = surface(height, start[:, None] + above[..., None] * shift[:, None], field.rule)
    assert (found - above).max() < tolerance


@pytest.mark.parametrize("rule", [REPEAT, MIRROR])
@pytest.mark.parametrize(("rows", "columns"), [(7, 12), (20, 9), (1, 5)])
def test_hits_are_the_first(rule: str, rows: int, columns: int) -> None:
    field = HeightField(rough_map(rows, columns, 0.3), rule, SLOPE)
    uv = 4.0 * torch.rand(120, 2, generator=torch.Generator().manual_seed(1)).double() - 2.0
    check_first_hits(field, uv, random_directions(120, 2, max_theta=math.atan(SLOPE)), 1e-9)


def test_single_precision_is_enough() -> None:
    field = HeightField(rough_map(64, 64, 0.1).float(), REPEAT, SLOPE)
    uv = torch.rand(200, 2, generator=torch.Generator().manual_seed(3))
    wo = random_directions(200, 4, max_theta=math.atan(SLOPE), dtype=torch.float32)
    check_first_hits(field, uv, wo, 2e-5)


def test_no_spike_of_one_texel_is_stepped_over() -> None:
    size, tall = 32, 0.2
    height = torch.zeros(size, size, dtype=torch.float64)
    height[size // 2, size // 2] = tall
    tip = torch.tensor([(size // 2 + 0.5) / size, 1.0 - (size // 2 + 0.5) / size]).double()
    phi = torch.linspace(0.0, 2.0 * math.pi, 97, dtype=torch.float64)[:-1]
    towards = torch.stack((torch.cos(phi), torch.sin(phi)), dim=-1)
    field = HeightField(height, REPEAT, SLOPE)
    for distance in (1e-3, 0.05, 0.5):
        target = tip + distance / size * towards  # on the side that the view sees
        t = torch.from_numpy(surface(height, target.numpy(), REPEAT))[:, None]
        wo = torch.cat((SLOPE * towards, torch.ones_like(t)), dim=-1) / math.hypot(1.0, SLOPE)
        found = field.hit(target - t * SLOPE * towards, wo)
        torch.testing.assert_close(found, target, rtol=0.0, atol=1e-9)


def test_rays_along_rows_and_columns_and_straight_down() -> None:
    field = HeightField(rough_map(6, 6, 0.4, seed=5), REPEAT, SLOPE)
    uv = torch.rand(40, 2, generator=torch.Generator().manual_seed(6)).double()
    uv[:10] = (torch.arange(20).view(10, 2) % 6 + 0.5) / 6  # centres
    for x, y in ((0.9, 0.0), (-0.9, 0.0), (0.0, 0.9), (0.0, -0.9), (0.64, 0.64), (1e-7, 0.0)):
        wo = torch.tensor([x, y, math.sqrt(1.0 - x * x - y * y)], dtype=torch.float64)
        if abs(x) + abs(y) > 1e-3:
            check_first_hits(field, uv, wo.expand(40, 3), 1e-9)
        else:
            torch.testing.assert_close(field.hit(uv, wo), uv, rtol=0.0, atol=1e-6)


def test_blocks_change_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    field = HeightField(rough_map(16, 16, 0.2).float(), REPEAT, SLOPE)
    uv = torch.rand(1000, 2, generator=torch.Generator().manual_seed(7))
    wo = random_directions(1000, 8, max_theta=1.5, dtype=torch.float32)
    whole = field.hit(uv, wo)
    monkeypatch.setattr(ray_walk, "CPU_BLOCK", 17)
    assert torch.equal(field.hit(uv, wo), whole)
    assert field.hit(uv[:0], wo[:0]).shape == (0, 2)
