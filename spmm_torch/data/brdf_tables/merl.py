"""MERL `.binary`: an isotropic BRDF as a table over half and difference angles [MPBM03, Rus98].

Little-endian: three int32 with the numbers of cells along theta_half, theta_difference and
phi_difference (90, 90, 180), then float64 values `[3, 90, 90, 180]`, channels first. Values are in
units of a scale for each channel; negative ones were not measured.
"""

from __future__ import annotations

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
# Part of a cell by which float32 directions miss an angle on an edge, which is of the upper cell.
EDGE = 1e-4


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

    As in the published reader, a value holds for its whole cell.

    Args:
        table: of `read_table`.
        wi, wo: unit directions `[Q, 3]` float64.
    """
    theta_half, theta_difference, phi_difference = cells(wi, wo)
    raw = table[:, theta_half, theta_difference, phi_difference].T  # [Q, 3]
    return np.where((raw < 0.0).any(1, keepdims=True), np.nan, raw * SCALE)


def cells(wi: np.ndarray, wo: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Cells (theta_half, theta_difference, phi_difference), each `[Q]`, of directions `[Q, 3]`."""
    theta_half, theta_difference, phi_difference = half_difference_angles(wi, wo)
    quarter = math.pi / 2.0
    parts = (
        90.0 * np.sqrt(theta_half / quarter),  # narrow cells about the mirror direction
        90.0 * theta_difference / quarter,
        180.0 * (phi_difference % math.pi) / math.pi,  # f(wi, wo) = f(wo, wi) adds pi to phi
    )
    found = [
        np.minimum((part + EDGE).astype(int), count - 1)
        for part, count in zip(parts, CELLS, strict=True)
    ]
    return found[0], found[1], found[2]


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
