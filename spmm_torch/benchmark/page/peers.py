"""Charts of the section peers: other methods for the same task."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from ...report.plots import Axis, Point, Series, plot
from ...report.views import Chart
from ...report.wording import decibels, median_time, size
from ..peers.problem import SEARCH, SELECTION, WHOLE

Row = Mapping[str, Any]
# Heading and note of each group, in the order of the page.
GROUPS = {
    WHOLE: ("Whole models", "Every texel."),
    SEARCH: (
        "Search for lobes",
        "A few texels only, evenly spread: a loop with SciPy is too slow for more.",
    ),
    SELECTION: (
        "Weights of given lobes",
        "Some texels, evenly spread, and the lobes of our default model.",
    ),
}


def peer_charts(part: Mapping[str, Any]) -> tuple[Chart, ...]:
    """Plots of whole models: time against SNR, and bytes against SNR."""
    # An exact model has no SNR, so it has no place on a plot.
    rows = [row for row in part["rows"] if row["group"] == WHOLE and row["snr_db"] is not None]
    timed = [(row["seconds"]["median"], row) for row in rows]
    sized = [(row["bytes"], row) for row in rows]
    return _chart(timed, "seconds", "Time against SNR"), _chart(sized, "bytes", "Bytes against SNR")


def _chart(costs: Sequence[tuple[float, Row]], unit: str, title: str) -> Chart:
    points: dict[str, list[Point]] = {"ours": [], "others": []}
    for cost, row in costs:
        text = (
            f"{row['name']}: {median_time(row['seconds'])}, {decibels(row['snr_db'])}, "
            f"{size(row['bytes'])}"
        )
        owner = "ours" if row["peer"] == "spmm" else "others"
        points[owner].append(Point(cost, row["snr_db"], text, row["name"]))
    series = [Series(owner, own) for owner, own in points.items()]
    drawing = plot(series, Axis(unit, log=True), Axis("SNR in dB"), title)
    return Chart(title, drawing, "Every method is named.")
