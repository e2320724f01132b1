"""Section weightings: errors and looks of each weighting."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ...report import wording
from ...report.markup import Markup, table
from .parts import Row, panel, section, time

TEXT = (
    "Default settings, each with another weighting of errors. SNR is that of unweighted values; "
    "MSSIM (1 is alike) and FLIP (0 is alike) are those of pictures of a sphere, as spmm evaluate "
    "makes them."
)
HEAD = ("Errors", "time", "SNR lobes", "SNR with residual", "lobes a texel", "MSSIM", "FLIP")


def weightings_section(part: Mapping[str, Any]) -> Markup:
    """A table of all weightings."""
    return section("Weighting of errors", TEXT, panel(table(HEAD, *map(_cells, part["rows"]))))


def _cells(row: Row) -> tuple[str, ...]:
    snr, flip = row["snr_db"], row["flip"]
    return (
        row["error"],
        time(row["seconds"]),
        wording.decibels(snr["without_residual"]),
        wording.decibels(snr["with_residual"]),
        wording.three_figures(row["mean_basis_per_texel"]),
        f"{row['mssim']['mean']:.4f}",
        wording.UNKNOWN if flip is None else f"{flip:.4f}",
    )
