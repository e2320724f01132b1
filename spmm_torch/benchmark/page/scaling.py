"""Section scaling: time over texels and directions."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ...report import wording
from ...report.markup import Markup, table
from ...report.plots import Axis, Point, Series, plot
from .parts import Row, duration, panel, panels, section

TEXT = (
    "Default settings. The values lie in memory, so decoding is not in it; more texels than the "
    "input has are repeats of it with smooth gains, other directions are interpolated. The power "
    "is that of the growth, fitted in logarithms: 1 is in proportion."
)
STAGES = ("cluster", "search", "select", "refit", "residual", "total")
SIZES = {"texels": "texels", "directions": "direction_pairs"}


def scaling_section(part: Mapping[str, Any]) -> Markup:
    """A plot for each device, threads and kind of growth; figures and powers in tables."""
    rows, exponents = part["rows"], part["exponents"]
    pictures = [_picture(each, rows) for each in exponents]
    head = ("Device", "threads", "texels", "direction pairs", *STAGES)
    seconds = table(head, *(_cells(row) for row in rows))
    powers = table(("Growth with", "device", "threads", *STAGES), *map(_powers, exponents))
    return section("Scaling", TEXT, panels(*pictures), panel(powers), panel(seconds))


def _picture(growth: Row, rows: list[Row]) -> tuple[str, Markup, str]:
    keys = ("varies", "device", "threads")
    own = [row for row in rows if all(row[key] == growth[key] for key in keys)]
    size = SIZES[growth["varies"]]
    series = [
        Series(
            stage,
            [Point(row[size], row["seconds"][stage], _told(row, stage)) for row in own],
            joined=True,
        )
        for stage in STAGES
    ]
    title = f"{growth['varies'].capitalize()}, {growth['device']}, {growth['threads']} threads"
    axes = Axis(size.replace("_", " "), log=True), Axis("seconds", log=True)
    power = growth["power"]["total"]
    told = "too fast to tell" if power is None else f"to the power {power:.2f}"
    return title, plot(series, *axes, title), f"All stages together grow {told}."


def _told(row: Row, stage: str) -> str:
    return f"{wording.plural(row['texels'], 'texel')}, {duration(row['seconds'][stage])}"


def _cells(row: Row) -> tuple[str, ...]:
    sizes = wording.count(row["texels"]), wording.count(row["direction_pairs"])
    seconds = (duration(row["seconds"][stage]) for stage in STAGES)
    return row["device"], str(row["threads"]), *sizes, *seconds


def _powers(row: Row) -> tuple[str, ...]:
    powers = (row["power"][stage] for stage in STAGES)
    shown = (wording.UNKNOWN if p is None else wording.signed(p, ".2f") for p in powers)
    return row["varies"], row["device"], str(row["threads"]), *shown
