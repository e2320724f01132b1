"""The pairs that the page shows are measured ones, near to what their titles say."""

from __future__ import annotations

import pytest
import torch
from torch import Tensor

from spmm_torch.geometry.directions import UBO2003_RINGS, UBO2014_RINGS, ring_directions
from spmm_torch.report.pairs import WANTED, angles, choose_pairs

UP = torch.tensor([[0.0, 0.0, 1.0]])


@pytest.mark.parametrize("rings", [UBO2003_RINGS, UBO2014_RINGS], ids=["81", "151"])
def test_measured_sets_have_every_pair(rings: tuple[tuple[float, int], ...]) -> None:
    directions = ring_directions(rings)
    pairs = choose_pairs(directions, directions)
    assert [pair.title for pair in pairs] == [row[0] for row in WANTED]
    assert len({(pair.light, pair.view) for pair in pairs}) == len(pairs)
    above, oblique, mirror, *grazing = pairs
    assert above.light == above.view == 0
    assert float(directions[oblique.light, 2]) == pytest.approx(0.5**0.5, abs=1e-3)
    assert oblique.view == 0
    half = directions[mirror.light] + directions[mirror.view]
    assert float(half[2] / half.norm()) > 0.999
    assert mirror.light != mirror.view
    for pair in grazing:
        assert min(float(directions[pair.light, 2]), float(directions[pair.view, 2])) < 0.27


@pytest.mark.parametrize("direction", [UP, ring_directions()[40:41]])
def test_one_direction_gives_one_pair(direction: Tensor) -> None:
    pairs = choose_pairs(direction, direction)
    assert [(pair.light, pair.view) for pair in pairs] == [(0, 0)]


def test_what_was_not_measured_is_left_out() -> None:
    lights = ring_directions()
    pairs = choose_pairs(lights, UP)
    assert [pair.title for pair in pairs] == [WANTED[0][0], WANTED[1][0]]
    assert {pair.view for pair in pairs} == {0}


def test_order_of_directions_does_not_matter() -> None:
    directions = ring_directions()
    order = torch.randperm(len(directions), generator=torch.Generator().manual_seed(0))
    shuffled = directions[order]
    for plain, mixed in zip(
        choose_pairs(directions, directions), choose_pairs(shuffled, shuffled), strict=True
    ):
        assert torch.equal(directions[plain.light], shuffled[mixed.light])
        assert torch.equal(directions[plain.view], shuffled[mixed.view])


@pytest.mark.parametrize(
    ("direction", "text"),
    [
        ((0.0, 0.0, 1.0), "0° / 0°"),
        ((1e-9, -1e-9, 1.0), "0° / 0°"),
        ((0.5**0.5, 0.0, 0.5**0.5), "45° / 0°"),
        ((0.5**0.5, -1e-7, 0.5**0.5), "45° / 0°"),
        ((0.0, -(0.75**0.5), 0.5), "60° / 270°"),
    ],
)
def test_angles(direction: tuple[float, float, float], text: str) -> None:
    assert angles(torch.tensor(direction)) == text


def test_missing_pairs_are_not_shown() -> None:
    directions = ring_directions()
    before = choose_pairs(directions, directions)
    missing = torch.zeros(len(directions), len(directions), dtype=torch.bool)
    missing[before[2].view, before[2].light] = True
    assert choose_pairs(directions, directions, missing) == (*before[:2], *before[3:])
    only = ~torch.zeros(2, 2, dtype=torch.bool)
    only[1, 0] = False
    (pair,) = choose_pairs(directions[:2], directions[:2], only)
    assert (pair.view, pair.light) == (1, 0)
