"""Section peers: other ways to do the same, whole and by part."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ...report import wording
from ...report.markup import Markup, join, table, tag
from ...report.plots import Axis, Point, Series, plot
from ..peers.problem import SEARCH, SELECTION, WHOLE
from .parts import Row, duration, finite_rows, panel, panels, section, time

TEXT = (
    "All start from decoded values. Vector quantization and local PCA get the bytes of our default "
    "model in float16; the neural BTF is trained for as long as our default fit takes, and longer."
)
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
HEAD = ("Method", "time", "a texel", "SNR", "lobes a texel", "size", "texels")


def peers_section(part: Mapping[str, Any]) -> Markup:
    """Plots of whole models, a table for each group, and who is missing."""
    whole = finite_rows(row for row in part["rows"] if row["group"] == WHOLE)
    timed = [(row["seconds"]["median"], row) for row in whole]
    sized = [(row["bytes"], row) for row in whole]
    note = "Every method is named."
    pictures = (
        ("Time against SNR", _plot(timed, Axis("seconds", log=True), "Time against SNR"), note),
        ("Bytes against SNR", _plot(sized, Axis("bytes", log=True), "Bytes against SNR"), note),
    )
    tables = [_group(group, part["rows"]) for group in GROUPS]
    missing = [f"{row['peer']} was skipped: {row['reason']}." for row in part["skipped"]]
    return section(
        "Other methods", TEXT, panels(*pictures), *tables, *(tag("p", m) for m in missing)
    )


def _plot(rows: list[tuple[float, Row]], axis: Axis, title: str) -> Markup:
    ours = [pair for pair in rows if pair[1]["peer"] == "spmm"]
    others = [pair for pair in rows if pair[1]["peer"] != "spmm"]
    series = [
        Series(name, [Point(cost, row["snr_db"], _told(row), row["name"]) for cost, row in pairs])
        for name, pairs in (("ours", ours), ("others", others))
    ]
    return plot(series, axis, Axis("SNR in dB"), title)


def _told(row: Row) -> str:
    return (
        f"{row['name']}: {time(row['seconds'])}, {wording.decibels(row['snr_db'])}, "
        f"{wording.size(row['bytes'])}"
    )


def _group(group: str, rows: list[Row]) -> Markup:
    title, text = GROUPS[group]
    own = [row for row in rows if row["group"] == group]
    notes = [
        tag("p", f"{row['name']}: {row['note']}.", class_="quiet") for row in own if row["note"]
    ]
    shown = table(HEAD, *(_cells(row) for row in own))
    return panel(join((tag("h3", title), tag("p", text, class_="quiet"), shown, *notes)))


def _cells(row: Row) -> tuple[str, ...]:
    lobes = row["mean_basis_per_texel"]
    return (
        row["name"],
        time(row["seconds"]),
        duration(row["seconds"]["median"] / row["texels"]),
        wording.decibels(row["snr_db"]),
        wording.UNKNOWN if lobes is None else wording.three_figures(lobes),
        wording.size(row["bytes"]),
        wording.count(row["texels"]),
    )
