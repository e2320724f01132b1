"""Charts as inline SVG; colours and fonts come from the page."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from markupsafe import Markup

from .svg import element

# Lengths in SVG units, about one pixel each.
WIDTH = 480
LABEL_WIDTH = 132
TEXT_WIDTH = 128
LETTER_WIDTH = 8.0  # of the page's type, in which texts beside bars are set
TEXT_GAP = 6
ROW_HEIGHT = 26
BAR_HEIGHT = 16
COLUMN_HEIGHT = 150
COLUMN_TOP = 20
COLUMN_MARGIN = 6
MAX_COLUMN_WIDTH = 44.0
AXIS_HEIGHT = 40
# Columns narrower than this have no room for their text.
MIN_TEXT_COLUMN = 30.0
# Free part of the width of a column.
GAP = 0.18


@dataclass(frozen=True)
class Bar:
    """One bar.

    Attributes:
        label: its name.
        value: its length, in the same unit for all bars.
        text: its value as text, beside it.
        colour: its own colour; empty for that of the page.
    """

    label: str
    value: float
    text: str
    colour: str = ""


def bar_chart(bars: Sequence[Bar], title: str) -> Markup:
    """Horizontal bars, one below the other."""
    longest = max((bar.value for bar in bars), default=0.0)
    letters = max((len(bar.text) for bar in bars), default=0)
    room = WIDTH - LABEL_WIDTH - max(TEXT_WIDTH, TEXT_GAP + LETTER_WIDTH * letters)
    scale = max(room, 0.0) / longest if longest > 0.0 else 0.0
    rows = [
        _row(bar, index * ROW_HEIGHT, scale * max(bar.value, 0.0)) for index, bar in enumerate(bars)
    ]
    return _frame(rows, max(len(bars), 1) * ROW_HEIGHT, title)


def histogram(bars: Sequence[Bar], axis: str, title: str) -> Markup:
    """Columns side by side over an axis."""
    highest = max((bar.value for bar in bars), default=0.0)
    scale = COLUMN_HEIGHT / highest if highest > 0.0 else 0.0
    width = min((WIDTH - 2 * COLUMN_MARGIN) / max(len(bars), 1), MAX_COLUMN_WIDTH)
    left = (WIDTH - width * len(bars)) / 2.0
    every = max(1, round(MIN_TEXT_COLUMN / width / 2.0))
    columns = [
        _column(bar, left + index * width, width, scale * bar.value, index % every == 0)
        for index, bar in enumerate(bars)
    ]
    foot = COLUMN_TOP + COLUMN_HEIGHT
    line = element("line", x1=0, x2=WIDTH, y1=foot, y2=foot, class_="axis")
    name = element("text", axis, x=WIDTH / 2, y=foot + AXIS_HEIGHT - 4, text_anchor="middle")
    return _frame([*columns, line, name] if bars else [], foot + AXIS_HEIGHT, title)


def _frame(parts: list[Markup], height: float, title: str) -> Markup:
    content = parts or [element("text", "nothing to show", x=0, y=BAR_HEIGHT, class_="quiet")]
    return element(
        "svg",
        element("title", title),
        *content,
        viewBox=f"0 0 {WIDTH} {height:g}",
        role="img",
    )


def _row(bar: Bar, top: float, length: float) -> Markup:
    baseline, start = top + BAR_HEIGHT - 3, LABEL_WIDTH + length + TEXT_GAP
    return element(
        "g",
        element("text", bar.label, x=LABEL_WIDTH - 8, y=baseline, text_anchor="end"),
        _rectangle(bar, LABEL_WIDTH, top, length, BAR_HEIGHT),
        element("text", bar.text, x=f"{start:.1f}", y=baseline, class_="quiet"),
    )


def _column(bar: Bar, left: float, width: float, height: float, labelled: bool) -> Markup:
    foot = COLUMN_TOP + COLUMN_HEIGHT
    middle = f"{left + width / 2:.1f}"
    parts = [_rectangle(bar, left + GAP * width / 2, foot - height, width * (1 - GAP), height)]
    if labelled:
        parts.append(element("text", bar.label, x=middle, y=foot + 16, text_anchor="middle"))
    if width >= MIN_TEXT_COLUMN:
        above = f"{foot - height - 5:.1f}"
        text = element(
            "text", bar.text, x=middle, y=above, text_anchor="middle", class_="quiet small"
        )
        parts.append(text)
    return element("g", *parts)


def _rectangle(bar: Bar, x: float, y: float, width: float, height: float) -> Markup:
    paint = {"fill": bar.colour} if bar.colour else {}
    return element(
        "rect",
        element("title", f"{bar.label}: {bar.text}"),
        x=f"{x:.1f}",
        y=f"{y:.1f}",
        width=f"{width:.1f}",
        height=f"{height:.1f}",
        class_="bar",
        **paint,
    )
