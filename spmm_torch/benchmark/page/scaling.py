"""Charts of the section scaling: time over texels and directions."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ...report.plots import Axis, Point, Series, plot
from ...report.views import Chart
from ...report.wording import plural, short_seconds

Row = Mapping[str, Any]
STAGES = ("cluster", "search", "select", "refit", "residual", "total")
SIZES = {"texels": "texels", "directions": "direction_pairs"}


def scaling_charts(part: Mapping[str, Any]) -> tuple[Chart, ...]:
    """A plot for each device, number of threads, and quantity that varies."""
    return tuple(_chart(growth, part["rows"]) for growth in part["exponents"])


def _chart(growth: Row, rows: list[Row]) -> Chart:
    keys = ("varies", "device", "threads")
    own = [row for row in rows if all(row[key] == growth[key] for key in keys)]
    size = SIZES[growth["varies"]]
    series = [
        Series(stage, [_point(row, size, stage) for row in own], joined=True) for stage in STAGES
    ]
    title = f"{growth['varies'].capitalize()}, {growth['device']}, {growth['threads']} threads"
    axes = Axis(size.replace("_", " "), log=True), Axis("seconds", log=True)
    power = growth["power"]["total"]
    caption = (
        "The fit is too fast to tell how its time grows."
        if power is None
        else f"Total time grows with the power {power:.2f} of the size."
    )
    return Chart(title, plot(series, *axes, title), caption)


def _point(row: Row, size: str, stage: str) -> Point:
    seconds = row["seconds"][stage]
    return Point(row[size], seconds, f"{plural(row['texels'], 'texel')}, {short_seconds(seconds)}")
