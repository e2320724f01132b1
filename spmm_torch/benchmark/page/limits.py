"""Section limits: time by stage, and each stage against what the machine can do."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ...report import wording
from ...report.charts import Bar, bar_chart
from ...report.markup import Markup, table
from .parts import Row, duration, panel, panels, section

TEXT = (
    "The machine does {flops} in products of matrices and moves {bytes} in copies, measured in the "
    "same run. What a stage must do is the least that its algorithm needs; as it is, every "
    "operation reads and writes memory by itself. Decoding is held against bare decoding of the "
    "pictures, where the input has any."
)
HEAD = ("Stage", "time", "must multiply", "must move", "limit", "of limit", "of its operations")
GIGA = 1e9


def limits_section(part: Mapping[str, Any]) -> Markup:
    """Bars of time and of the reached share of the limit, and a table."""
    rows, machine = part["rows"], part["machine"]
    times = [Bar(_name(row), row["seconds"], duration(row["seconds"])) for row in rows]
    shares = [Bar(_name(row), row["fraction"] or 0.0, _percent(row["fraction"])) for row in rows]
    text = TEXT.format(
        flops=f"{machine['flops_per_second'] / GIGA:.1f} Gflop/s",
        bytes=f"{machine['bytes_per_second'] / GIGA:.1f} GB/s",
    )
    pictures = (
        ("Time by stage", bar_chart(times, "Time by stage"), "Default settings."),
        ("Share of the limit", bar_chart(shares, "Share of the limit"), "100 % cannot be beaten."),
    )
    cells = (_cells(row) for row in rows)
    return section(
        "Stages against their limits", text, panels(*pictures), panel(table(HEAD, *cells))
    )


def _name(row: Row) -> str:
    return row["stage"].capitalize()


def _percent(share: float | None) -> str:
    return wording.UNKNOWN if share is None else f"{100.0 * share:.1f} %"


def _cells(row: Row) -> tuple[str, ...]:
    return (
        _name(row),
        duration(row["seconds"]),
        f"{row['flops'] / GIGA:,.1f} Gflop",
        wording.size(row["bytes"]),
        duration(row["limit_seconds"]),
        _percent(row["fraction"]),
        _percent(row["counted_fraction"]),
    )
