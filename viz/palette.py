"""Colours of the viewers: calm on a light page, and distinct for colour-blind readers."""

from __future__ import annotations

from ..brdf import MODEL_NAMES

Colour = tuple[float, float, float]  # red, green, blue from 0 to 1, as displays take them

PAGE: Colour = (0.975, 0.975, 0.968)
TEXT: Colour = (0.13, 0.15, 0.17)
QUIET: Colour = (0.42, 0.45, 0.48)
LINE: Colour = (0.78, 0.79, 0.78)
SUM: Colour = (0.62, 0.68, 0.74)
# Okabe and Ito, "Color Universal Design", 2008, without black; then darker and duller ones.
SERIES: tuple[Colour, ...] = (
    (0.00, 0.45, 0.70),
    (0.84, 0.37, 0.00),
    (0.00, 0.62, 0.45),
    (0.80, 0.47, 0.65),
    (0.90, 0.62, 0.00),
    (0.34, 0.71, 0.91),
    (0.60, 0.45, 0.32),
    (0.50, 0.50, 0.50),
    (0.33, 0.27, 0.62),
    (0.60, 0.66, 0.15),
    (0.64, 0.10, 0.24),
    (0.10, 0.35, 0.33),
)


def series_colour(number: int) -> Colour:
    """The colour of lobe `number`, counted from 0; colours repeat after the last."""
    return SERIES[number % len(SERIES)]


def model_colour(model: int) -> Colour:
    """The colour of a BRDF, an index into `MODEL_NAMES`; the same in all pictures."""
    return series_colour(model % len(MODEL_NAMES))
