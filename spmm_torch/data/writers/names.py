"""File names that tell directions, as UBO2003 has them and `parse_angles` reads them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

from ...errors import OutputError

if TYPE_CHECKING:
    from torch import Tensor

# Names keep 0.001 degrees: directions are measured to a tenth, and stored to 0.00001 in float32.
DECIMALS = 3
FULL_TURN = 360.0

Angles = tuple[str, str]  # polar angle and azimuth in degrees, as a name gives them


def picture_names(view: Tensor, light: Tensor, suffix: str) -> list[list[str]]:
    """Names `[V][L]` such as `tv030_pv030/00008 tl000 pl000 tv030 pv030.jpg`.

    Pictures are numbered as in UBO2003, light * V + view, and lie in a folder for each view.

    Raises:
        OutputError: two directions are the same in names.
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
    """The angles of unit vectors `[N, 3]`, in degrees of at least three digits.

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
    x, y, z = vector
    # Unlike arccos, exact near the pole.
    theta = _text(math.degrees(math.atan2(math.hypot(x, y), z)))
    phi = _text(math.degrees(math.atan2(y, x)))
    return theta, ("000" if theta == "000" else phi)


def _text(degrees: float) -> str:
    """Degrees in [0, 360), without decimals that say nothing: `015`, `023.5`."""
    rounded = round(degrees, DECIMALS) % FULL_TURN
    return f"{rounded:0{4 + DECIMALS}.{DECIMALS}f}".rstrip("0").rstrip(".")
