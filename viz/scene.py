"""A scene of a viewer as plain arrays: surfaces, lines, dots, words and pictures in space.

Nothing here imports VTK: `plotter` draws scenes and `html` exports them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .palette import TEXT, Colour

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Surface:
    """Triangles `[F, 3]` between points `[N, 3]`; flat ones are not shaded."""

    points: Floats
    triangles: NDArray[np.int64]
    colour: Colour
    opacity: float = 1.0
    flat: bool = False


@dataclass(frozen=True)
class Lines:
    """Polylines through the points `[P, n, 3]`, P of them with n points each."""

    points: Floats
    colour: Colour
    width: float = 1.0  # pixels


@dataclass(frozen=True)
class Arrow:
    """An arrow from `start [3]` along `vector [3]`."""

    start: Floats
    vector: Floats
    colour: Colour


@dataclass(frozen=True)
class Dots:
    """Small balls at points `[N, 3]`, of one radius, in one colour each `[N, 3]`."""

    points: Floats
    radius: float
    colours: Floats


@dataclass(frozen=True)
class Word:
    """Flat letters about the point `at [3]`.

    Attributes:
        height: of a capital letter.
        right, up: unit vectors along the line and along the letters `[3]`.
        align: whether `at` is the "centre" of the line or its "left" end.
    """

    text: str
    at: Floats
    height: float
    right: Floats
    up: Floats
    colour: Colour = TEXT
    align: str = "centre"


@dataclass(frozen=True)
class Picture:
    """8-bit codes `[H, W, 3]` on a rectangle about `centre [3]`, row 0 along +`up`."""

    codes: NDArray[np.uint8]
    centre: Floats
    right: Floats  # half of the width
    up: Floats  # half of the height


Part = Surface | Lines | Arrow | Dots | Word | Picture


@dataclass(frozen=True)
class LegendRow:
    """A line of the legend: text, and the colour of the square before it; None for no square."""

    text: str
    colour: Colour | None = None


@dataclass(frozen=True)
class View:
    """Where the camera stands.

    Attributes:
        focus: the point in the middle `[3]`.
        direction: from the focus to the camera, unit `[3]`.
        up: `[3]`.
        half_height: half of the picture's height, at the focus.
    """

    focus: Floats
    direction: Floats
    up: Floats
    half_height: float


@dataclass(frozen=True)
class Scene:
    """Parts in space with their legend.

    Attributes:
        title: one line.
        parts: what stands in space.
        legend: lines of text.
        view: where the camera stands at first.
        size: pixels of the picture or window, width and height.
    """

    title: str
    parts: tuple[Part, ...]
    legend: tuple[LegendRow, ...]
    view: View
    size: tuple[int, int] = (1280, 720)
