"""Checks of measured directions, the same for every reader."""

from __future__ import annotations

import torch
from scipy.spatial import KDTree
from torch import Tensor

from ..errors import DataError

# Tolerance of the length of unit vectors; float16 rounds it by up to 1e-3.
UNIT_TOLERANCE = 2e-3
# Tolerance of z at the horizon: rounding makes cos(pi / 2) -4e-8 in float32, 5e-4 in float16.
HORIZON_TOLERANCE = 1e-3
# Chord (0.06 degrees) below which two directions are the same; grids are degrees apart.
SAME_DIRECTION = 1e-3


def checked_directions(directions: Tensor, where: str) -> Tensor:
    """Directions `[N, 3]` as float32 unit vectors in the closed upper hemisphere, no two the same.

    Raises:
        DataError: the shape is wrong, or a direction is not finite, not unit, below the horizon or
            there twice.
    """
    exact = _units(directions, where)
    _check_distinct(exact, where)
    return exact.float()


def unit_directions(directions: Tensor, where: str) -> Tensor:
    """Directions `[N, 3]` as float32 unit vectors in the closed upper hemisphere, in any number.

    Raises:
        DataError: the shape is wrong, or a direction is not finite, not unit or below the horizon.
    """
    return _units(directions, where).float()


def _units(directions: Tensor, where: str) -> Tensor:
    """The same in float64."""
    if directions.ndim != 2 or directions.shape[-1] != 3 or len(directions) == 0:
        raise DataError(
            f"{where} has shape {list(directions.shape)}; expected [N, 3] with N of at least 1; "
            f"store one unit vector per direction."
        )
    exact = directions.to(torch.float64, copy=True)  # [N, 3]; the caller's stay as they are
    length = exact.norm(dim=-1)  # [N]
    _refuse(
        ~(length.isfinite() & (length > 0.0)),
        exact,
        f"{where} holds a vector that is no direction",
        "mend it, or leave it out together with its pictures",
    )
    _refuse(
        ~((length - 1.0).abs() <= UNIT_TOLERANCE),
        exact,
        f"{where} holds a direction that is not unit",
        "divide each vector by its length",
    )
    _refuse(
        exact[:, 2] < -HORIZON_TOLERANCE,
        exact,
        f"{where} holds a direction under the horizon",
        "z is the surface normal and directions point away from the surface: turn or remove it",
    )
    exact[:, 2].clamp_min_(0.0)
    return exact / exact.norm(dim=-1, keepdim=True)


def _refuse(bad: Tensor, directions: Tensor, what: str, remedy: str) -> None:
    """Raises a DataError that names the first bad one, `bad [N]`, of `directions [N, 3]`."""
    if bad.any():
        index = int(bad.nonzero()[0])
        vector = ", ".join(f"{value:.6g}" for value in directions[index].tolist())
        raise DataError(f"{what}: number {index} (from 0) is ({vector}); {remedy}.")


def _check_distinct(directions: Tensor, where: str) -> None:
    """Refuses `directions [N, 3]` of which two are the same."""
    pairs = KDTree(directions.numpy()).query_pairs(SAME_DIRECTION)
    if pairs:
        first, second = min(pairs)
        raise DataError(
            f"{where} holds the same direction twice, as numbers {first} and {second} (from 0); "
            f"expected distinct directions; remove one together with its pictures."
        )
