"""Colours of other primaries than those of linear sRGB, which are those of Rec.709.

A file names the places of its primaries and of its white on the chromaticity diagram. Their sums of
X, Y and Z follow from the white having Y = 1. A white other than D65 is adapted to it by
Bradford's method, so that equal channels stay as they are.

Sources: `RGBtoXYZ` in *Technical Introduction to OpenEXR*; SMPTE RP 177-1993; Lam, Metamerism and
Colour Constancy, PhD thesis, University of Bradford, 1985.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from .base import UnsuitableError

# x and y of red, green, blue and white.
REC709 = (0.64, 0.33, 0.30, 0.60, 0.15, 0.06, 0.3127, 0.3290)
# How far primaries may be from those of Rec.709 and still be them: headers are rounded.
ROUNDING = 2e-3
# Least area between primaries, as a determinant, of those that span colours.
LEAST_AREA = 1e-4
BRADFORD = np.array(
    [[0.8951, 0.2664, -0.1614], [-0.7502, 1.7135, 0.0367], [0.0389, -0.0685, 1.0296]]
)


def are_rec709(chromaticities: Sequence[float]) -> bool:
    """Whether x and y of red, green, blue and white are those of Rec.709, up to rounding."""
    return bool(np.allclose(chromaticities, REC709, rtol=0.0, atol=ROUNDING))


def xyz_of_rgb(chromaticities: Sequence[float]) -> np.ndarray:
    """The matrix `[3, 3]` from linear RGB to XYZ, in which white has Y = 1.

    Args:
        chromaticities: x and y of red, green, blue and white.

    Raises:
        ValueError: these span no colours.
    """
    place = np.array(chromaticities, dtype=np.float64)
    if place.shape != (8,) or not np.isfinite(place).all():
        raise UnsuitableError(
            f"its chromaticities are {_text(chromaticities)}; expected eight numbers"
        )
    x, y = place.reshape(4, 2).T
    xyz = np.stack((x, y, 1.0 - x - y))  # [3, 4], columns are primaries and white
    if abs(np.linalg.det(xyz[:, :3])) < LEAST_AREA or y[3] <= 0.0:
        raise UnsuitableError(
            f"its chromaticities {_text(chromaticities)} span no colours; expected those of its "
            f"primaries and its white: correct or remove them"
        )
    return xyz[:, :3] * np.linalg.solve(xyz[:, :3], xyz[:, 3] / y[3])


def rec709_of_rgb(chromaticities: Sequence[float]) -> np.ndarray:
    """The matrix `[3, 3]` from linear RGB to that of Rec.709, white to white.

    Args:
        chromaticities: x and y of red, green, blue and white.

    Raises:
        ValueError: these span no colours.
    """
    here, there = xyz_of_rgb(chromaticities), xyz_of_rgb(REC709)
    cones = [BRADFORD @ matrix.sum(1) for matrix in (here, there)]  # of both whites
    adapted = np.linalg.solve(BRADFORD, (cones[1] / cones[0])[:, None] * BRADFORD)
    return np.linalg.solve(there, adapted @ here)


def _text(chromaticities: Sequence[float]) -> str:
    return ", ".join(f"{number:g}" for number in chromaticities)
