"""A table of numbers as inline SVG: coloured cells with their numbers."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from markupsafe import Markup

from .pictures import css_colour, heat_colours
from .svg import element

# Lengths in SVG units, about one pixel each.
WIDTH, ROW_HEIGHT, CELL_GAP = 480, 26, 1
LEFT, TOP, FOOT = 66, 4, 44
STEPS = 256
# Text is dark on colours lighter than this luma, of 255.
LIGHT_LUMA = 140.0
LUMA = np.array([0.299, 0.587, 0.114])
UNKNOWN_COLOUR = "#8884"


@dataclass(frozen=True)
class Axis:
    """One side of a heat map: its name, and the label of each row or column."""

    name: str
    labels: Sequence[str]


def heat_map(
    values: Sequence[Sequence[float]],
    texts: Sequence[Sequence[str]],
    rows: Axis,
    columns: Axis,
    title: str,
) -> Markup:
    """Cells coloured from the least to the greatest value; values that are not finite are grey.

    Args:
        values: one list for each row of cells.
        texts: of the cells.
        rows, columns: names and labels of the sides.
        title: description for screen readers.
    """
    table = np.array(values, dtype=np.float64).reshape(len(rows.labels), len(columns.labels))
    position = scaled(table)
    width = (WIDTH - LEFT) / len(columns.labels)
    cells = [
        _cell(position[row, column], texts[row][column], LEFT + column * width, row, width)
        for row in range(len(rows.labels))
        for column in range(len(columns.labels))
    ]
    foot = TOP + ROW_HEIGHT * len(rows.labels)
    middle = {"text_anchor": "middle"}
    labels = [
        element("text", text, x=LEFT - 8, y=TOP + row * ROW_HEIGHT + 18, text_anchor="end")
        for row, text in enumerate(rows.labels)
    ]
    labels += [
        element("text", text, x=f"{LEFT + (column + 0.5) * width:.1f}", y=foot + 16, **middle)
        for column, text in enumerate(columns.labels)
    ]
    turned = f"translate(14 {(TOP + foot) / 2:g}) rotate(-90)"
    labels.append(element("text", rows.name, transform=turned, **middle))
    labels.append(element("text", columns.name, x=(LEFT + WIDTH) / 2, y=foot + FOOT - 8, **middle))
    box = f"0 0 {WIDTH} {foot + FOOT}"
    return element("svg", element("title", title), *cells, *labels, viewBox=box, role="img")


def scaled(table: np.ndarray) -> np.ndarray:
    """Values from 0 for the least to 1 for the greatest; NaN for those that are not finite."""
    finite = np.where(np.isfinite(table), table, np.nan)
    if np.isnan(finite).all():
        return finite
    low, high = np.nanmin(finite), np.nanmax(finite)
    return (finite - low) / (high - low) if high > low else np.where(np.isnan(finite), finite, 0.5)


def _cell(position: float, text: str, left: float, row: int, width: float) -> Markup:
    colour, dark = UNKNOWN_COLOUR, False
    if math.isfinite(position):
        codes = heat_colours(STEPS)[round(position * (STEPS - 1))]
        colour, dark = css_colour(codes), float(codes @ LUMA) > LIGHT_LUMA
    top = TOP + row * ROW_HEIGHT
    ink = {"style": f"fill:{'#14171a' if dark else '#ffffff'}"} if math.isfinite(position) else {}
    return element(
        "g",
        element(
            "rect",
            x=f"{left:.1f}",
            y=top,
            width=f"{width - CELL_GAP:.1f}",
            height=ROW_HEIGHT - CELL_GAP,
            fill=colour,
        ),
        element(
            "text",
            text,
            x=f"{left + width / 2:.1f}",
            y=top + 17,
            text_anchor="middle",
            class_="small",
            **ink,
        ),
    )
