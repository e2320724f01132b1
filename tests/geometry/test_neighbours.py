"""The nearest of many directions, as a table of all pairs tells them."""

from __future__ import annotations

import pytest
import torch

from spmm_torch.geometry.directions import ring_directions
from spmm_torch.geometry.neighbours import nearest
from tests.planted.directions import random_directions


@pytest.mark.parametrize("count", [1, 4])
@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_neighbours_are_those_of_a_table(count: int, dtype: torch.dtype) -> None:
    points, among = random_directions(200, seed=1).to(dtype), random_directions(90, seed=2)
    distance, index = nearest(points, among, count)
    table = (points.double()[:, None] - among.double()).norm(dim=2)
    least = table.topk(count, dim=1, largest=False)
    torch.testing.assert_close(distance, least.values)
    assert torch.equal(index, least.indices)


def test_a_direction_is_found_at_no_distance_at_all() -> None:
    """Products of float32 would put it some 1e-4 away from itself."""
    rings = ring_directions()
    distance, index = nearest(rings, rings)
    assert torch.equal(index[:, 0], torch.arange(len(rings)))
    assert not distance.any()
