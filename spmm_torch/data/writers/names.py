"""File names with directions, as in UBO2003 and as `parse_angles` reads them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

from ...errors import OutputError

if TYPE_CHECKING:
    from torch import Tensor

# Decimals of degrees: directions are measured to 0.1 and stored to 0.00001 degrees.
DECIMALS = 3
FULL_TURN = 360.0  # degrees

Angles = tuple[str, str]  # polar angle and azimuth in degrees, as in file names


def picture_names(view: Tensor, light: Tensor, suffix: str) -> list[list[str]]:
    """Names `[V][L]` such as `tv030_pv030/00008 tl000 pl000 tv030 pv030.jpg`.

    Pictures are numbered as in UBO2003, light * V + view, with a folder for each view.

    Args:
        view, light: unit vectors `[V, 3]`, `[L, 3]`.
        suffix: suffix of the files, with its dot.

    Raises:
        OutputError: two directions have the same name.
    """
    views = direction_texts(view, "views")
    lights = direction_texts(light, "lights")
    return [
        [
            f"tv{tv}_pv{pv}/{l * len(views) + v:05} tl{tl} pl{pl} tv{tv} pv{pv}{suffix}"
            for l, (tl, pl) in enumerate(lights)  # noqa: E741
        ]
        for v, (tv, pv) in enumerate(views)
    ]


def direction_texts(directions: Tensor, what: str) -> list[Angles]:
    """The angles of N unit vectors `[N, 3]` in degrees, as texts of at least three digits.

    Raises:
        OutputError: two directions have the same text.
    """
    texts = [_angles(vector) for vector in directions.double().tolist()]
    first: dict[Angles, int] = {}
    for number, text in enumerate(texts):
        if text in first:
            raise OutputError(
                f"{what} {first[text]} and {number} are both (theta {text[0]}, phi {text[1]}) in "
                f"file names; expected directions at least {10**-DECIMALS:g} degrees apart; "
                f"write NPZ instead."
            )
        first[text] = number
    return texts


def _angles(vector: Sequence[float]) -> Angles:
    """The polar angle and azimuth of a unit vector, as texts."""
    x, y, z = vector
    # atan2 is accurate near the pole, unlike arccos.
    theta = _text(math.degrees(math.atan2(math.hypot(x, y), z)))
    phi = _text(math.degrees(math.atan2(y, x)))
    return theta, ("000" if theta == "000" else phi)


def _text(degrees: float) -> str:
    """Degrees in [0, 360) without trailing zeros, such as `015` or `023.5`."""
    rounded = round(degrees, DECIMALS) % FULL_TURN
    return f"{rounded:0{4 + DECIMALS}.{DECIMALS}f}".rstrip("0").rstrip(".")
