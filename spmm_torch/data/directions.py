"""Checks of measured directions, the same for every reader."""

from __future__ import annotations

import torch
from torch import Tensor

from ..errors import DataError

# Unit vectors that went through float16 are off by up to 1e-3.
UNIT_TOLERANCE = 2e-3
# cos(pi / 2) is not zero in floating point: -4e-8 in float32, 5e-4 after float16.
HORIZON_TOLERANCE = 1e-3
# Measured grids are degrees apart; closer than this chord (0.06 degrees) is the same direction.
SAME_DIRECTION = 1e-3


def checked_directions(directions: Tensor, where: str) -> Tensor:
    """Directions `[N, 3]` as float32 unit vectors in the closed upper hemisphere.

    Raises:
        DataError: wrong shape, not finite, not unit, under the horizon, or twice the same.
    """
    if directions.ndim != 2 or directions.shape[-1] != 3 or len(directions) == 0:
        raise DataError(
            f"{where} has shape {list(directions.shape)}; expected [N, 3] with N of at least 1; "
            f"store one unit vector per direction."
        )
    exact = directions.double()  # [N, 3]
    length = exact.norm(dim=-1)  # [N]
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
    exact = exact / exact.norm(dim=-1, keepdim=True)
    _check_distinct(exact, where)
    return exact.float()


def _refuse(bad: Tensor, directions: Tensor, what: str, remedy: str) -> None:
    if bad.any():
        index = int(bad.nonzero()[0])
        vector = ", ".join(f"{value:.6g}" for value in directions[index].tolist())
        raise DataError(f"{what}: number {index} (from 0) is ({vector}); {remedy}.")


def _check_distinct(directions: Tensor, where: str) -> None:
    distance = torch.cdist(directions, directions, compute_mode="donot_use_mm_for_euclid_dist")
    same = (distance < SAME_DIRECTION).triu(diagonal=1)  # [N, N]
    if same.any():
        first, second = same.nonzero()[0].tolist()
        raise DataError(
            f"{where} holds the same direction twice, as numbers {first} and {second} (from 0); "
            f"expected distinct directions; remove one together with its pictures."
        )
