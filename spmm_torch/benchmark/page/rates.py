"""Charts of the section rates: bytes against error, and sentences on where peers are ahead."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from ...report.plots import Axis, Point, Series, plot
from ...report.views import Chart
from ...report.wording import decibels, fixed, short_seconds, size, three_figures
from ..front import pareto_front
from ..rates.leads import SIGNS, comparable

Row = Mapping[str, Any]
AXES = {
    "bytes_per_texel": Axis("bytes a texel", log=True),
    "bytes": Axis("bytes in all", log=True),
    "snr_db": Axis("SNR in dB"),
    "flip": Axis("FLIP"),
}
WORDS = {"snr_db": "SNR", "flip": "FLIP"}


def rate_charts(part: Mapping[str, Any]) -> tuple[Chart, ...]:
    """Plots of SNR and FLIP over bytes a texel and over all bytes, for each material."""
    charts = []
    for material in dict.fromkeys(row["material"] for row in part["rows"]):
        rows = [row for row in part["rows"] if row["material"] == material]
        for quality in WORDS:
            own = [row for row in rows if row[quality] is not None]
            if not own:
                continue
            for cost in ("bytes_per_texel", "bytes"):
                title = f"{material}: {AXES[quality].name} over {AXES[cost].name}"
                drawing = plot(
                    _series(comparable(own, cost), cost, quality), AXES[cost], AXES[quality], title
                )
                caption = "Higher is better." if quality == "snr_db" else "Lower is better."
                charts.append(Chart(title, drawing, caption))
    return tuple(charts)


def _series(rows: Sequence[Row], cost: str, quality: str) -> list[Series]:
    """A line for each method: of ours with all points, of others with those on its own front."""
    series = []
    for curve in dict.fromkeys(row["curve"] for row in rows):
        own = [row for row in rows if row["curve"] == curve]
        if not own[0]["ours"]:
            qualities = [SIGNS[quality] * row[quality] for row in own]
            front = pareto_front(qualities, [row[cost] for row in own])
            own = [row for row, best in zip(own, front, strict=True) if best]
        own.sort(key=lambda row: row[cost])
        points = [Point(row[cost], row[quality], _text(row)) for row in own]
        series.append(Series(curve, points, joined=True))
    return series


def _text(row: Row) -> str:
    return (
        f"{row['name']}: {three_figures(row['bytes_per_texel'])} bytes a texel, "
        f"{size(row['bytes'])}, {decibels(row['snr_db'])}, FLIP {fixed(row['flip'], 3)}, "
        f"{short_seconds(row['seconds'])}"
    )


def lead_lines(part: Mapping[str, Any]) -> tuple[str, ...]:
    """One sentence for each range of bytes in which a peer is ahead of us.

    Where a peer alone is so small, one sentence is enough for both errors.
    """
    return tuple(dict.fromkeys(_line(lead) for lead in part["leads"]))


def _line(lead: Row) -> str:
    told = size if lead["cost"] == "bytes" else three_figures
    unit = "" if lead["cost"] == "bytes" else " bytes a texel"
    first, end = told(lead["first"]), None if lead["end"] is None else told(lead["end"])
    curve = lead["curve"]
    if lead["lead"] is None:
        return f"{lead['material']}: {curve} begins at {first}{unit}, ours at {end}{unit}."
    where = f"from {first}{unit} on" if end is None else f"from {first} to {end}{unit}"
    amount = decibels(lead["lead"]) if lead["quality"] == "snr_db" else fixed(lead["lead"], 3)
    quality = WORDS[lead["quality"]]
    return f"{lead['material']}, {quality}: {curve} is ahead by up to {amount}, {where}."
