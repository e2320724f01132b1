"""Sets of directions with holes, which nothing else shows."""

from __future__ import annotations

import pytest

from spmm_torch.data.file_names import Direction
from spmm_torch.data.picture_grid import PictureGrid, hole_notes

UBO2003 = ((0, 1), (15, 6), (30, 12), (45, 18), (60, 20), (75, 24))


def rings(*counts: tuple[int, int], digits: int | None = None) -> tuple[Direction, ...]:
    return tuple(
        (float(theta), float(round(360 * i / n, digits))) for theta, n in counts for i in range(n)
    )


FULL = rings(*UBO2003)


def notes(view: tuple[Direction, ...], light: tuple[Direction, ...] = FULL) -> tuple[str, ...]:
    return hole_notes(PictureGrid(view, light, ()))


@pytest.mark.parametrize(
    "directions",
    [
        FULL,
        rings((0, 1), (30, 14), (60, 33)),  # names round azimuths to whole degrees
        rings((45, 2), (60, 3), (75, 1)),
        ((30.0, 3.0), (30.0, 91.0), (30.0, 170.0), (30.0, 301.0)),  # at random
        ((30.0, 0.0), (30.0, 1.5), (30.0, 190.0)),
    ],
)
def test_whole_sets(directions: tuple[Direction, ...]) -> None:
    assert notes(directions, directions) == ()


def test_one_view_is_a_camera_that_stands_still() -> None:
    assert notes(((0.0, 0.0),)) == ()


def test_every_second_view() -> None:
    assert notes(FULL[::2]) == ("note: the 41 views lack 40 of the 81 directions of the lights",)


def test_every_second_light() -> None:
    expected = ("note: the 41 lights lack 40 of the 81 directions of the views",)
    assert notes(FULL, FULL[::2]) == expected


def test_holes_that_views_and_lights_share() -> None:
    gone = {(15.0, 60.0), (30.0, 0.0), (30.0, 330.0), (75.0, 180.0)}
    left = tuple(direction for direction in FULL if direction not in gone)
    places = "1 at 15 degrees, 2 at 30 degrees, 1 at 75 degrees"
    assert notes(left, left) == tuple(
        f"note: the 77 {name} have holes in their rings, 4 in all: {places}"
        for name in ("views", "lights")
    )
