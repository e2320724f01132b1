"""Charts of the section sweep: SNR of our own settings against time and bytes."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

from ...report.plots import Axis, Point, Series, plot
from ...report.views import Chart
from ...report.wording import decibels, median_time, size

Row = Mapping[str, Any]
KINDS = {"without_residual": "SNR of lobes alone", "with_residual": "SNR with residual"}
SECONDS, BYTES = Axis("seconds from file to model", log=True), Axis("bytes of the model", log=True)
Cost = Callable[[Row], float]


def sweep_charts(part: Mapping[str, Any]) -> tuple[Chart, ...]:
    """Plots of both SNRs over both costs."""
    costs: tuple[tuple[str, str, Axis, Cost], ...] = (
        ("Time", "seconds", SECONDS, lambda row: row["seconds"]["median"]),
        ("Bytes", "bytes", BYTES, lambda row: row["bytes"]["total"]),
    )
    caption = "Only shipped settings are labelled; point at a mark for its name."
    charts = []
    for name, front, axis, cost in costs:
        for kind, error in KINDS.items():
            title = f"{name} against {error}"
            series = _series(part["rows"], kind, front, cost)
            charts.append(Chart(title, plot(series, axis, Axis("dB"), title), caption))
    return tuple(charts)


def _series(rows: list[Row], kind: str, front: str, cost: Cost) -> list[Series]:
    shipped = [row for row in rows if row["group"] == "shipped"]
    others = [row for row in rows if row["group"] != "shipped"]
    best = [row for row in others if row["on_front"][front]]
    rest = [row for row in others if not row["on_front"][front]]
    return [
        Series("shipped settings", [_point(row, kind, cost, row["name"]) for row in shipped]),
        Series("variants on the front", [_point(row, kind, cost) for row in best]),
        Series("other variants", [_point(row, kind, cost) for row in rest]),
    ]


def _point(row: Row, kind: str, cost: Cost, label: str = "") -> Point:
    snr = row["snr_db"][kind]
    text = (
        f"{row['name']}: {median_time(row['seconds'])}, {decibels(snr)}, "
        f"{size(row['bytes']['total'])}"
    )
    return Point(cost(row), math.nan if snr is None else snr, text, label)
