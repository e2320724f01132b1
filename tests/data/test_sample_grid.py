"""Which lists of samples fill a grid, and that telling it takes little memory."""

from __future__ import annotations

import tracemalloc
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from spmm_torch.data.sample_grid import Samples, grid_of
from spmm_torch.geometry.directions import ring_directions

DIRECTIONS = ring_directions(((30.0, 20), (45.0, 40), (60.0, 40))).double().numpy()  # [100, 3]
PATH = Path("list.npz")


def listed(view: np.ndarray, light: np.ndarray, texel: np.ndarray) -> Samples:
    """Samples of other values at views and lights of a rig, `[N]` each."""
    rgb = np.arange(3 * len(view), dtype=np.float32).reshape(-1, 3)
    size = (1, int(texel.max()) + 1)
    return Samples(DIRECTIONS[light], DIRECTIONS[view], rgb, texel, size, None)


def quarter(side: int, texels: int) -> Samples:
    """The quarter of all pairs of `side` views and lights, a multiple of four, in each texel."""
    view = np.repeat(np.arange(side), side // 4)
    light = (view + 4 * np.tile(np.arange(side // 4), side)) % side
    texel = np.repeat(np.arange(texels), len(view))
    return listed(np.tile(view, texels), np.tile(light, texels), texel)


@pytest.mark.parametrize("mask", [False, True])
@pytest.mark.parametrize("texels", [1, 3, 7])
def test_a_quarter_of_the_pairs_in_every_texel_is_a_grid(texels: int, mask: bool) -> None:
    grid = grid_of(quarter(12, texels), mask, PATH)
    assert grid is not None
    assert (grid.values.shape, int((~grid.missing).sum())) == ((12, 12, texels, 3), 36)
    assert np.isfinite(grid.values[~grid.missing]).all()


@pytest.mark.parametrize("mask", [False, True])
def test_one_pair_less_in_one_texel_is_none(mask: bool) -> None:
    whole = quarter(12, 3)
    parts = {key: getattr(whole, key)[1:] for key in ("wi", "wo", "rgb", "texel")}
    assert grid_of(replace(whole, **parts), mask, PATH) is None


@pytest.mark.parametrize("mask", [False, True])
def test_few_pairs_of_each_of_many_texels_take_little_memory(mask: bool) -> None:
    """The grid of 100 lights, 100 views and 500 texels would have a thousand times the samples."""
    texel = np.repeat(np.arange(500), 10)
    view, light = np.random.default_rng(0).integers(0, 100, (2, len(texel)))
    samples = listed(view, light, texel)
    tracemalloc.start()
    try:
        assert grid_of(samples, mask, PATH) is None
        assert tracemalloc.get_traced_memory()[1] < 4 << 20
    finally:
        tracemalloc.stop()
