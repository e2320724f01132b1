"""What the sections of the page are made of."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from ...report import wording
from ...report.markup import Markup, figure, join, tag

Row = Mapping[str, Any]
# Seconds below which milliseconds are shown.
SHORT, MILLISECONDS = 0.1, 1e3


def section(title: str, text: str, *content: Markup) -> Markup:
    """A headed part of the page with an introduction."""
    return join((tag("h2", title), tag("p", text, class_="quiet"), *content))


def panels(*rows: tuple[str, Markup, str]) -> Markup:
    """Pictures side by side, each (heading, picture, caption)."""
    parts = (
        tag("div", tag("h3", head), figure(body, text), class_="panel") for head, body, text in rows
    )
    return tag("div", *parts, class_="panels")


def panel(content: Markup) -> Markup:
    """One thing across the page."""
    return tag("div", content, class_="panel")


def time(seconds: Row) -> str:
    """Median, and the spread where there was more than one run."""
    text = duration(seconds["median"])
    if seconds["runs"] == 1:
        return text
    half = 0.5 * (seconds["slowest"] - seconds["fastest"])
    return f"{text} ± {100.0 * half / seconds['median']:.0f} %"


def duration(seconds: float) -> str:
    """Seconds for people, milliseconds where they are short."""
    if seconds < SHORT:
        return f"{wording.three_figures(MILLISECONDS * seconds)} ms"
    return wording.seconds(seconds)


def finite_rows(rows: Iterable[Row]) -> list[Row]:
    """Rows that have an error; a perfect fit, null in the file, has no place on a plot."""
    return [row for row in rows if row["snr_db"] is not None]
