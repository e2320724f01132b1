"""Plots as inline SVG: points and lines over two axes; colours and fonts come from the page."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

from markupsafe import Markup

from .scales import Scale, tick_text
from .svg import element

# Lengths in SVG units, about one pixel each.
WIDTH, HEIGHT = 560, 360
LEFT, RIGHT, TOP, BOTTOM = 58, 16, 12, 46
LEGEND_ROW, LEGEND_COLUMNS, LEGEND_TOP = 20, 3, 10
RADIUS = 4.5
# Width and height of a letter in a label, and the gap between a label and its point.
LETTER, LINE, GAP = 6.2, 13.0, 7.0
# Number of different looks of series, after which they repeat; style.css.j2 has their colours.
LOOKS = 7


@dataclass(frozen=True)
class Axis:
    """One axis: its name, and whether it is logarithmic."""

    name: str
    log: bool = False


@dataclass(frozen=True)
class Point:
    """One point: its values, its text under the pointer, and its label, if any."""

    x: float
    y: float
    text: str
    label: str = ""


@dataclass(frozen=True)
class Series:
    """Points of one kind, in the order of the line that joins them if `joined`."""

    name: str
    points: Sequence[Point]
    joined: bool = False


def plot(series: Sequence[Series], x_axis: Axis, y_axis: Axis, title: str) -> Markup:
    """Series over two axes, with a legend.

    Args:
        series: points; values that are not finite, or not positive on a logarithmic axis, are
            left out.
        x_axis, y_axis: of the plot.
        title: description for screen readers.
    """
    drawn = [_visible(each, x_axis, y_axis) for each in series]
    points = [point for each in drawn for point in each.points]
    if not points:
        content = [element("text", "nothing to show", x=0, y=LINE, class_="quiet")]
    else:
        x = Scale.over([point.x for point in points], LEFT, WIDTH - RIGHT, x_axis.log)
        y = Scale.over([point.y for point in points], HEIGHT - BOTTOM, TOP, y_axis.log)
        canvas = _Canvas(x, y)
        content = [*_axes(x, y, x_axis, y_axis)]
        content += [canvas.draw(each, look) for look, each in enumerate(drawn)]
        content += [canvas.labels(drawn), *(legend(each, look) for look, each in enumerate(drawn))]
    return framed(title, content, len(drawn))


def framed(title: str, content: Sequence[Markup], entries: int) -> Markup:
    """A plot with room for a legend of some entries below.

    Args:
        title: description for screen readers.
        content: all that is drawn, the legend too.
        entries: how many series the legend names.
    """
    height = HEIGHT + LEGEND_TOP + LEGEND_ROW * -(-entries // LEGEND_COLUMNS)
    return element(
        "svg",
        element("title", title),
        *content,
        viewBox=f"0 0 {WIDTH} {height}",
        role="img",
        class_="plot",
    )


def _visible(series: Series, x_axis: Axis, y_axis: Axis) -> Series:
    def shown(value: float, axis: Axis) -> bool:
        return math.isfinite(value) and (value > 0.0 or not axis.log)

    kept = [p for p in series.points if shown(p.x, x_axis) and shown(p.y, y_axis)]
    return Series(series.name, kept, series.joined)


def _axes(x: Scale, y: Scale, x_axis: Axis, y_axis: Axis) -> list[Markup]:
    foot, middle = HEIGHT - BOTTOM, (TOP + HEIGHT - BOTTOM) / 2
    parts = []
    for tick in x.ticks():
        place = f"{x(tick):.1f}"
        parts.append(element("line", x1=place, x2=place, y1=TOP, y2=foot, class_="grid"))
        parts.append(element("text", tick_text(tick), x=place, y=foot + 17, text_anchor="middle"))
    for tick in y.ticks():
        place = f"{y(tick):.1f}"
        parts.append(element("line", x1=LEFT, x2=WIDTH - RIGHT, y1=place, y2=place, class_="grid"))
        parts.append(
            element("text", tick_text(tick), x=LEFT - 7, y=f"{y(tick) + 4:.1f}", text_anchor="end")
        )
    turned = f"translate(14 {middle:g}) rotate(-90)"
    right = (LEFT + WIDTH - RIGHT) / 2
    parts.append(element("text", x_axis.name, x=right, y=foot + 38, text_anchor="middle"))
    parts.append(element("text", y_axis.name, transform=turned, text_anchor="middle"))
    return parts


@dataclass
class _Canvas:
    """The area of a plot, and its occupied boxes (left, top, right, bottom)."""

    x: Scale
    y: Scale
    taken: list[tuple[float, float, float, float]] = field(default_factory=list)

    def draw(self, series: Series, look: int) -> Markup:
        """The line and the marks of one series."""
        places = [(self.x(point.x), self.y(point.y)) for point in series.points]
        parts = []
        if series.joined and len(places) > 1:
            path = " ".join(f"{left:.1f},{top:.1f}" for left, top in places)
            parts.append(element("polyline", points=path, class_=f"s{look % LOOKS} line"))
        for point, (left, top) in zip(series.points, places, strict=True):
            self.taken.append((left - RADIUS, top - RADIUS, left + RADIUS, top + RADIUS))
            parts.append(mark(look, left, top, f"{series.name}: {point.text}"))
        return element("g", *parts)

    def labels(self, series: Sequence[Series]) -> Markup:
        """Labels, each beside its point where it covers least."""
        parts = []
        for point in (point for each in series for point in each.points if point.label):
            left, top = self.x(point.x), self.y(point.y)
            width = LETTER * len(point.label)
            box = min(_boxes(left, top, width), key=self._crowding)
            self.taken.append(box)
            parts.append(
                element(
                    "text",
                    point.label,
                    x=f"{box[0]:.1f}",
                    y=f"{box[3] - 3.0:.1f}",
                    class_="small",
                )
            )
        return element("g", *parts)

    def _crowding(self, box: tuple[float, float, float, float]) -> float:
        """The area of a box that is occupied or outside of the plot, weighted."""
        outside = max(LEFT - box[0], 0.0) + max(box[2] - (WIDTH - RIGHT), 0.0)
        outside += max(TOP - box[1], 0.0) + max(box[3] - (HEIGHT - BOTTOM), 0.0)
        return LINE * outside + sum(_overlap(box, other) for other in self.taken)


def _boxes(left: float, top: float, width: float) -> list[tuple[float, float, float, float]]:
    """Boxes (left, top, right, bottom) for a label around its point, by preference."""
    half, middle = LINE / 2, width / 2
    corners = [(left + GAP, top - half), (left - GAP - width, top - half)]
    corners += [(left - middle, top - GAP - LINE), (left - middle, top + GAP)]
    corners += [(left + GAP, top - GAP - LINE), (left + GAP, top + GAP)]
    corners += [(left - GAP - width, top - GAP - LINE), (left - GAP - width, top + GAP)]
    return [(a, b, a + width, b + LINE) for a, b in corners]


def _overlap(
    one: tuple[float, float, float, float], other: tuple[float, float, float, float]
) -> float:
    width = min(one[2], other[2]) - max(one[0], other[0])
    height = min(one[3], other[3]) - max(one[1], other[1])
    return max(width, 0.0) * max(height, 0.0)


def legend(series: Series, look: int) -> Markup:
    """The entry of a series below a plot."""
    column, row = look % LEGEND_COLUMNS, look // LEGEND_COLUMNS
    left = LEFT + column * (WIDTH - LEFT - RIGHT) / LEGEND_COLUMNS
    top = HEIGHT + LEGEND_TOP + row * LEGEND_ROW
    name = element("text", series.name, x=f"{left + 12:.1f}", y=f"{top + 4:.1f}")
    return mark(look, left, top, series.name) + name


def mark(look: int, left: float, top: float, text: str) -> Markup:
    """The mark of a series: its shape distinguishes it without colour."""
    title = element("title", text)
    class_ = f"s{look % LOOKS} mark"
    shape = look % 4
    r = RADIUS
    if shape == 0:
        return element("circle", title, cx=f"{left:.1f}", cy=f"{top:.1f}", r=r, class_=class_)
    corners = {
        1: ((-r, -r), (r, -r), (r, r), (-r, r)),
        2: ((0.0, -1.3 * r), (1.2 * r, r), (-1.2 * r, r)),
        3: ((0.0, -1.4 * r), (1.4 * r, 0.0), (0.0, 1.4 * r), (-1.4 * r, 0.0)),
    }[shape]
    path = " ".join(f"{left + dx:.1f},{top + dy:.1f}" for dx, dy in corners)
    return element("polygon", title, points=path, class_=class_)
