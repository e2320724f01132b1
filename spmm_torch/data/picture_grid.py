"""The pictures of every light under every view, and what is missing among them."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path

import torch
from torch import Tensor

from ..errors import DataError
from ..geometry.directions import direction_from_angles
from .file_names import Direction, Pair

# Tolerance in degrees of the steps of a ring: names round azimuths to whole degrees.
ROUNDING = 1.0
# Least step in degrees of a ring that is even: with smaller ones rounding would make any ring even.
LEAST_STEP = 5.0
FULL_TURN = 360.0  # degrees


@dataclass(frozen=True)
class PictureGrid:
    """The pictures of every light under every view.

    Attributes:
        view, light: directions (theta, phi) in degrees, V and L of them.
        files: file names in the order d = view * L + light; None for a pair without a picture.
    """

    view: tuple[Direction, ...]
    light: tuple[Direction, ...]
    files: tuple[str | None, ...]

    @property
    def first(self) -> str:
        """The name of the first picture."""
        return next(name for name in self.files if name is not None)

    @property
    def missing(self) -> Tensor | None:
        """Whether each pair lacks a picture, `[V, L]` bool; None if none does."""
        if None not in self.files:
            return None
        flat = torch.tensor([name is None for name in self.files])
        return flat.view(len(self.view), len(self.light))


def arrange(
    names: Iterable[str], path: Path, parse: Callable[[str], Pair | None], mask: bool = False
) -> PictureGrid:
    """Arranges pictures by all pairs of their views and lights.

    Args:
        names: file names of the pictures.
        path: zip or folder of the pictures, for messages.
        parse: function that gives the directions in a name; names without any are left out.
        mask: whether pairs may be missing.

    Raises:
        DataError: a direction pair is missing or there twice, or a direction is below the horizon.
    """
    files: dict[Pair, str] = {}
    for name in names:
        pair = parse(name)
        if pair is None:
            continue
        _check_above_horizon(pair, name, path)
        if pair in files:
            raise DataError(
                f"{path} holds {_describe(pair)} twice, as {files[pair]!r} and {name!r}; expected "
                f"each direction pair once; remove one of them, or split two materials."
            )
        files[pair] = name
    view = tuple(sorted({pair[0] for pair in files}))
    light = tuple(sorted({pair[1] for pair in files}))
    product = [(v, l) for v in view for l in light]  # noqa: E741
    missing = [pair for pair in product if pair not in files]
    if missing and not mask:
        raise DataError(
            f"{path} lacks {_describe(missing[0])} ({len(missing)} missing of {len(product)} "
            f"pairs = {len(view)} views x {len(light)} lights); expected a picture of every light "
            f"under every view; add the missing pictures, remove the misnamed ones, or go on "
            f"without them by data.missing=mask."
        )
    return PictureGrid(view, light, tuple(files.get(pair) for pair in product))


def _check_above_horizon(pair: Pair, name: str, path: Path) -> None:
    for theta, _ in pair:
        if not 0.0 <= theta <= 90.0:
            raise DataError(
                f"picture {name!r} in {path} has a polar angle of {theta:g} degrees, under the "
                f"horizon; expected 0 to 90, counted from the surface normal; rename or remove it."
            )


def _describe(pair: Pair) -> str:
    """The pair (view, light) in words."""
    (view_theta, view_phi), (light_theta, light_phi) = pair
    return (
        f"the pair light (theta {light_theta:g}, phi {light_phi:g}), "
        f"view (theta {view_theta:g}, phi {view_phi:g})"
    )


def hole_notes(grid: PictureGrid) -> tuple[str, ...]:
    """What the views and the lights seem to lack, by each other and by their rings: a line each.

    A set that lacks whole views still has every light under every view, so nothing else shows it.
    """
    pairs = (("views", grid.view, "lights", grid.light), ("lights", grid.light, "views", grid.view))
    return tuple(filter(None, (_hole_note(*pair) for pair in pairs)))


def _hole_note(
    name: str, directions: Sequence[Direction], other: str, others: Sequence[Direction]
) -> str | None:
    if len(directions) == 1:  # a camera that stands still, or one lamp
        return None
    start = f"note: the {len(directions)} {name}"
    if set(directions) < set(others):
        absent = len(others) - len(directions)
        return f"{start} lack {absent} of the {len(others)} directions of the {other}"
    holes = {theta: count for theta, count in _ring_holes(directions) if count}
    if not holes:
        return None
    places = ", ".join(f"{count} at {theta:g} degrees" for theta, count in holes.items())
    return f"{start} have holes in their rings, {sum(holes.values())} in all: {places}"


def _ring_holes(directions: Sequence[Direction]) -> list[tuple[float, int]]:
    """Each polar angle of sorted directions, and how many azimuths its even steps leave out."""
    found = []
    for theta, ring in groupby(directions, key=lambda direction: direction[0]):
        azimuths = [phi for _, phi in ring]
        around = [*azimuths[1:], azimuths[0] + FULL_TURN]
        gaps = [after - before for before, after in zip(azimuths, around, strict=True)]
        found.append((theta, _left_out(gaps) if len(gaps) > 1 else 0))
    return found


def _left_out(gaps: Sequence[float]) -> int:
    """How many places of an even ring lie inside `gaps`; 0 if its steps are not even."""
    if min(gaps) < LEAST_STEP:
        return 0
    count = round(FULL_TURN / min(gaps))
    step = FULL_TURN / count
    steps = [max(round(gap / step), 1) for gap in gaps]
    even = all(abs(gap - n * step) <= ROUNDING for gap, n in zip(gaps, steps, strict=True))
    return count - len(gaps) if even and sum(steps) == count else 0


def unit_vectors(directions: Sequence[Direction]) -> Tensor:
    """Unit vectors `[N, 3]` float32 of N directions in degrees."""
    theta, phi = torch.deg2rad(torch.tensor(directions, dtype=torch.float64)).unbind(-1)
    return direction_from_angles(theta, phi).float()
