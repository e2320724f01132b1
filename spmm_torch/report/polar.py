"""Polar plots as inline SVG: values over the angle in the plane of incidence."""

from __future__ import annotations

import math
from collections.abc import Sequence

from markupsafe import Markup

from .plots import (
    HEIGHT,
    LOOKS,
    TOP,
    WIDTH,
    Series,
    framed,
    legend,
    mark,
)
from .svg import element

FOOT = HEIGHT - 30  # where the surface lies
RADIUS = min(FOOT - TOP - 20.0, WIDTH / 2.0 - 34.0)
SPOKES = range(-90, 91, 30)  # degrees
ARCS = 4


def polar_plot(series: Sequence[Series], title: str, light: float) -> Markup:
    """Series over the upper half of the plane of incidence, with a legend.

    Args:
        series: x of a point is its angle from the normal in radians, to the right; y its radius,
            relative to the greatest of all.
        title: description for screen readers.
        light: angle of the light, which is drawn as a dashed line.
    """
    greatest = max((p.y for each in series for p in each.points if math.isfinite(p.y)), default=0.0)
    scale = RADIUS / greatest if greatest > 0.0 else 0.0
    content = [*_web(), _light(light)]
    content += [_drawn(each, look, scale) for look, each in enumerate(series)]
    content += [legend(each, look) for look, each in enumerate(series)]
    return framed(title, content, len(series))


def _place(angle: float, radius: float) -> tuple[float, float]:
    return WIDTH / 2.0 + radius * math.sin(angle), FOOT - radius * math.cos(angle)


def _web() -> list[Markup]:
    """Spokes with their angles, and half circles."""
    parts = []
    for degrees in SPOKES:
        angle = math.radians(degrees)
        parts.append(_line(angle, "grid"))
        left, top = _place(angle, RADIUS + 12.0)
        parts.append(
            element(
                "text", f"{degrees}°", x=f"{left:.1f}", y=f"{top + 4:.1f}", text_anchor="middle"
            )
        )
    for arc in range(1, ARCS + 1):
        radius = RADIUS * arc / ARCS
        (left, foot), (right, _) = _place(-math.pi / 2, radius), _place(math.pi / 2, radius)
        path = f"M {left:.1f} {foot:.1f} A {radius:.1f} {radius:.1f} 0 0 1 {right:.1f} {foot:.1f}"
        parts.append(element("path", d=path, class_="grid", fill="none"))
    return parts


def _light(angle: float) -> Markup:
    return _line(angle, "ray")


def _line(angle: float, class_: str) -> Markup:
    left, top = _place(angle, RADIUS)
    return element(
        "line",
        x1=WIDTH / 2,
        y1=FOOT,
        x2=f"{left:.1f}",
        y2=f"{top:.1f}",
        class_=class_,
    )


def _drawn(series: Series, look: int, scale: float) -> Markup:
    """The line of a series that is joined, or the marks of one that is not."""
    shown = [point for point in series.points if math.isfinite(point.y)]
    places = [_place(point.x, scale * max(point.y, 0.0)) for point in shown]
    if series.joined:
        path = " ".join(f"{left:.1f},{top:.1f}" for left, top in places)
        return element("polyline", points=path, class_=f"s{look % LOOKS} line")
    marks = [
        mark(look, *place, f"{series.name}: {point.text}")
        for point, place in zip(shown, places, strict=True)
    ]
    return element("g", *marks)
