"""Charts of the section limits: time of each stage, and its limit over its time."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ...report.charts import Bar, bar_chart
from ...report.views import Chart
from ...report.wording import percent, short_seconds


def limit_charts(part: Mapping[str, Any]) -> tuple[Chart, ...]:
    """Bars of the time of each stage, and of its limit over its time."""
    rows = part["rows"]
    times = [
        Bar(row["stage"].capitalize(), row["seconds"], short_seconds(row["seconds"]))
        for row in rows
    ]
    fractions = [
        Bar(row["stage"].capitalize(), row["fraction"] or 0.0, percent(row["fraction"]))
        for row in rows
    ]
    return (
        Chart("Time by stage", bar_chart(times, "Time by stage"), "Default settings."),
        Chart(
            "Limit over time", bar_chart(fractions, "Limit over time"), "No stage can exceed 100 %."
        ),
    )
