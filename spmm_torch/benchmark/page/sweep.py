"""Section sweep: time against SNR and bytes against SNR of our own settings."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

from ...report import wording
from ...report.markup import Markup, table
from ...report.plots import Axis, Point, Series, plot
from .parts import Row, panel, panels, section, time

TEXT = (
    "Each variant changes one setting of the default. A setting is on a front if no other has as "
    "high a mean of the two SNRs at a lower cost, or a higher one at no more: in seconds, in bytes "
    "or in both, where another must be neither slower nor larger. Variants that differ from "
    "another one only behind the search take its clusters and lobes over, with the seconds that "
    "those took."
)
HEAD = (
    "Settings",
    "time",
    "SNR lobes",
    "SNR with residual",
    "lobes a texel",
    "lobes",
    "size",
    "peak memory",
    "on the front",
)
KINDS = {"without_residual": "SNR of lobes alone", "with_residual": "SNR with residual"}
SECONDS, BYTES = Axis("seconds from file to model", log=True), Axis("bytes of the model", log=True)
Cost = Callable[[Row], float]


def sweep_section(part: Mapping[str, Any]) -> Markup:
    """Plots of both errors over both costs, and a table of all settings."""
    rows = part["rows"]
    costs: tuple[tuple[str, str, Axis, Cost], ...] = (
        ("Time", "seconds", SECONDS, lambda row: row["seconds"]["median"]),
        ("Bytes", "bytes", BYTES, lambda row: row["bytes"]["total"]),
    )
    pictures = [
        (
            f"{name} against {title}",
            plot(_series(rows, kind, front, cost), axis, Axis("dB"), f"{name} against {title}"),
            "Settings that ship are named; the others tell their name under the pointer.",
        )
        for name, front, axis, cost in costs
        for kind, title in KINDS.items()
    ]
    shown = panel(table(HEAD, *(_cells(row) for row in rows)))
    return section("Our own settings", TEXT, panels(*pictures), shown)


def _series(rows: list[Row], kind: str, front: str, cost: Cost) -> list[Series]:
    def points(chosen: list[Row], labelled: bool) -> list[Point]:
        return [
            Point(
                cost(row),
                math.nan if row["snr_db"][kind] is None else row["snr_db"][kind],
                f"{row['name']}: {time(row['seconds'])}, "
                f"{wording.decibels(row['snr_db'][kind])}, {wording.size(row['bytes']['total'])}",
                row["name"] if labelled else "",
            )
            for row in chosen
        ]

    own = [row for row in rows if row["group"] == "shipped"]
    others = [row for row in rows if row["group"] != "shipped"]
    best = [row for row in others if row["on_front"][front]]
    rest = [row for row in others if not row["on_front"][front]]
    return [
        Series("settings that ship", points(own, True)),
        Series("variants on the front", points(best, False)),
        Series("other variants", points(rest, False)),
    ]


def _cells(row: Row) -> tuple[str, ...]:
    snr, front = row["snr_db"], row["on_front"]
    return (
        row["name"],
        time(row["seconds"]),
        wording.decibels(snr["without_residual"]),
        wording.decibels(snr["with_residual"]),
        wording.three_figures(row["mean_basis_per_texel"]),
        wording.count(row["total_basis"]),
        wording.size(row["bytes"]["total"]),
        wording.size(row["peak_memory_bytes"]),
        ", ".join(cost for cost in front if front[cost]) or wording.UNKNOWN,
    )
