"""The sample of slices: fixed, measured, and spread over all rings."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch

from spmm_torch.data import BTF
from spmm_torch.evaluate.angles import rings
from spmm_torch.evaluate.slice_sample import (
    LIGHTS_ABOVE,
    SLICES,
    pairs_from_above,
    spread_pairs,
)
from spmm_torch.geometry.directions import UBO2003_RINGS, ring_directions
from tests.planted.btfs import COARSE_RINGS, rough_btf


def without_values(rings: tuple[tuple[float, int], ...], missing: torch.Tensor | None) -> BTF:
    """A BTF of which only the directions are asked for."""
    directions = ring_directions(rings)
    return replace(rough_btf(2), view=directions, light=directions, missing=missing)


def test_every_ring_of_views_and_lights_has_its_part() -> None:
    btf = without_values(UBO2003_RINGS, None)
    pairs = spread_pairs(btf)
    assert len(pairs) == len(set(pairs)) == SLICES
    ring, degrees = rings(btf.view)
    expected = torch.bincount(ring) * SLICES / len(btf.view)
    for side in (0, 1):
        chosen = ring[[pair[side] for pair in pairs]]
        found = torch.bincount(chosen, minlength=len(degrees))
        assert float((found - expected).abs().max()) < 2.0


def test_the_order_of_directions_does_not_matter_for_rings() -> None:
    btf = without_values(UBO2003_RINGS, None)
    order = torch.randperm(len(btf.view), generator=torch.Generator().manual_seed(0))
    mixed = replace(btf, view=btf.view[order], light=btf.light[order])
    for before, after in zip(spread_pairs(btf), spread_pairs(mixed), strict=True):
        assert float(btf.view[before[0], 2]) == pytest.approx(float(mixed.view[after[0], 2]))
        assert float(btf.light[before[1], 2]) == pytest.approx(float(mixed.light[after[1], 2]))


def test_missing_pairs_are_left_out() -> None:
    count = len(ring_directions(UBO2003_RINGS))
    missing = torch.rand(count, count, generator=torch.Generator().manual_seed(0)) < 0.5
    missing[0] = True  # nothing from above
    btf = without_values(UBO2003_RINGS, missing)
    pairs = spread_pairs(btf) + pairs_from_above(btf)
    assert not any(bool(missing[pair]) for pair in pairs)
    assert len(pairs_from_above(btf)) == LIGHTS_ABOVE
    assert len({view for view, _ in pairs_from_above(btf)}) == 1


def test_few_pairs_are_all_taken() -> None:
    btf = without_values(((0.0, 1), (45.0, 4)), None)
    assert sorted(spread_pairs(btf)) == [(view, light) for view in range(5) for light in range(5)]
    assert sorted(pairs_from_above(btf)) == [(0, light) for light in range(5)]


def test_from_above_is_the_highest_view_under_lights_of_all_heights() -> None:
    btf = without_values(COARSE_RINGS, None)
    pairs = pairs_from_above(btf)
    assert {view for view, _ in pairs} == {0}
    heights = btf.light[[light for _, light in pairs], 2]
    assert float(heights.max()) > 0.9
    assert float(heights.min()) == pytest.approx(float(btf.light[:, 2].min()))
