"""MERL `.binary`: an isotropic BRDF as a table over half and difference angles [MPBM03, Rus98].

Little-endian: three int32 with the numbers of cells along theta_half, theta_difference and
phi_difference (90, 90, 180), then float64 values `[3, 90, 90, 180]`, channels first. Values are in
units of a scale for each channel; negative ones were not measured.
"""

from __future__ import annotations

import itertools
import math

import numpy as np

from ...errors import DataError

SUFFIX = ".binary"
TITLE = "MERL .binary"
CELLS = (90, 90, 180)  # theta_half, theta_difference, phi_difference
HEADER = np.array(CELLS, "<i4").tobytes()
SIZE = len(HEADER) + 3 * math.prod(CELLS) * 8
# What the published reader multiplies red, green and blue by.
SCALE = np.array((1.0 / 1500.0, 1.15 / 1500.0, 1.66 / 1500.0))
PERIODIC = (False, False, True)
HALF = 0.5  # part of the cells around a place that must be measured


def read_table(payload: bytes, where: str) -> np.ndarray:
    """The table `[3, 90, 90, 180]` float64 of a file, unscaled; read-only.

    Raises:
        DataError: the numbers of cells or the size are not those of the format.
    """
    if payload[: len(HEADER)] != HEADER or len(payload) != SIZE:
        raise DataError(
            f"{where} is no MERL table: it has {len(payload):,} bytes and starts with "
            f"{_start(payload)}; expected {SIZE:,} bytes and the cells 90, 90, 180; "
            f"copy it again from the database."
        )
    return np.frombuffer(payload, "<f8", offset=len(HEADER)).reshape(3, *CELLS)


def _start(payload: bytes) -> str:
    head = payload[: len(HEADER)]
    whole = len(head) == len(HEADER)
    return ", ".join(map(str, np.frombuffer(head, "<i4"))) if whole else "no whole header"


def evaluate(table: np.ndarray, wi: np.ndarray, wo: np.ndarray) -> np.ndarray:
    """The BRDF `[Q, 3]` in 1/sr of a `table [3, 90, 90, 180]`, without a cosine; NaN: not measured.

    Values stand for the middle of their cell, where the published reader gives the same, and are
    interpolated linearly between: directions at whole degrees meet the edges of cells. Cells that
    were not measured are left out, where they count for less than half.

    Args:
        table: of `read_table`.
        wi, wo: unit directions `[Q, 3]` float64.
    """
    near = [_between(*axis) for axis in zip(_places(wi, wo), CELLS, PERIODIC, strict=True)]
    total, measured = np.zeros((3, len(wi))), np.zeros(len(wi))
    for sides in itertools.product((0, 1), repeat=3):
        cell = tuple(index[side] for side, (index, _) in zip(sides, near, strict=True))
        weight = math.prod(share[side] for side, (_, share) in zip(sides, near, strict=True))
        raw = table[:, *cell]  # [3, Q]
        weight = np.where((raw < 0.0).any(0), 0.0, weight)
        total += weight * raw
        measured += weight
    known = np.where(measured < HALF, np.nan, measured)
    return (total / known).T * SCALE


def _places(wi: np.ndarray, wo: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Places `[Q]` along theta_half, theta_difference and phi_difference, in cells from the first.

    Cells of theta_half are narrow about the mirror direction: their edges lie at i^2 / 90 degrees.
    """
    theta_half, theta_difference, phi_difference = half_difference_angles(wi, wo)
    quarter = math.pi / 2.0
    return (
        90.0 * np.sqrt(theta_half / quarter),
        90.0 * theta_difference / quarter,
        180.0 * phi_difference / math.pi,
    )


def _between(place: np.ndarray, count: int, periodic: bool) -> tuple[np.ndarray, np.ndarray]:
    """The two cells whose middles are around each place `[Q]`, and their shares, both `[2, Q]`.

    f(wi, wo) = f(wo, wi) adds pi to phi_difference, so that its last cell is beside the first.
    """
    from_middle = place - 0.5
    if not periodic:
        from_middle = np.clip(from_middle, 0.0, count - 1.0)
    first = np.floor(from_middle).astype(int)
    share = from_middle - first
    pair = np.stack((first, first + 1))
    pair = pair % count if periodic else np.minimum(pair, count - 1)
    return pair, np.stack((1.0 - share, share))


def half_difference_angles(
    wi: np.ndarray, wo: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Angles (theta_half, theta_difference, phi_difference) in radians, each `[Q]` [Rus98].

    The difference direction is wi in the frame in which the half vector is z.

    Args:
        wi, wo: unit directions `[Q, 3]`.
    """
    half = wi + wo
    half = half / np.linalg.norm(half, axis=1, keepdims=True)
    theta, phi = polar_angle(half), np.arctan2(half[:, 1], half[:, 0])
    x = np.cos(phi) * wi[:, 0] + np.sin(phi) * wi[:, 1]
    y = np.cos(phi) * wi[:, 1] - np.sin(phi) * wi[:, 0]
    tilted = np.cos(theta) * x - np.sin(theta) * wi[:, 2]
    z = np.sin(theta) * x + np.cos(theta) * wi[:, 2]
    return theta, np.arctan2(np.hypot(tilted, y), z), np.arctan2(y, tilted)


def polar_angle(directions: np.ndarray) -> np.ndarray:
    """Angles `[Q]` from z in radians of `directions [Q, 3]`, exact near z, where arccos is not."""
    return np.arctan2(np.hypot(directions[:, 0], directions[:, 1]), directions[:, 2])
