"""Places in a texture and directions over it, as words of a command line."""

from __future__ import annotations

import math
from argparse import ArgumentTypeError


def texel(text: str) -> tuple[int, int]:
    """Column and row of a texel: the type of `--texel X,Y`.

    Raises:
        ArgumentTypeError: not two whole numbers.
    """
    try:
        x, y = (int(word) for word in text.split(","))
    except ValueError:
        raise ArgumentTypeError(f"{text!r} is no texel; expected X,Y such as 12,30") from None
    return x, y


def view_angles(text: str) -> tuple[float, float]:
    """Polar angle and azimuth of wo in radians: the type of `--view THETA,PHI` in degrees.

    Raises:
        ArgumentTypeError: not two numbers, or not above the horizon.
    """
    try:
        theta, phi = (math.radians(float(word)) for word in text.split(","))
    except ValueError:
        raise ArgumentTypeError(f"{text!r} is no view; expected THETA,PHI in degrees") from None
    if not (0.0 <= theta < 0.5 * math.pi and math.isfinite(phi)):
        raise ArgumentTypeError(f"{text!r} is no view; expected THETA from 0 to below 90 degrees")
    return theta, phi


def rectangle(text: str) -> tuple[int, ...]:
    """Left column, top row, width and height of a rectangle of texels: the type of `--crop`.

    Raises:
        ArgumentTypeError: not four whole numbers.
    """
    try:
        x, y, width, height = (int(word) for word in text.split(","))
    except ValueError:
        raise ArgumentTypeError(
            f"{text!r} is no rectangle; expected X,Y,WIDTH,HEIGHT such as 64,64,32,32"
        ) from None
    return x, y, width, height
