"""Rows of the table: one thing that was measured each."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path


@dataclass(frozen=True)
class Row:
    """One line of the table.

    Attributes:
        name: what was done.
        seconds: that it took; None: not timed.
        flops, bytes: of its operations, counted in a second run; None: not counted.
        peak: bytes of device memory at most; None: not known.
        note: errors and other figures, in words.
    """

    name: str
    seconds: float | None = None
    flops: float | None = None
    bytes: float | None = None
    peak: int | None = None
    note: str = ""


Put = Callable[[Row], None]


def writer(place: Path) -> Put:
    """A function that adds a row to a file at once; a later row of the same name replaces it."""

    def put(row: Row) -> None:
        with place.open("a", encoding="utf-8") as file:
            file.write(json.dumps(asdict(row)) + "\n")

    return put


def read(place: Path) -> list[Row]:
    """The rows of a file, without a last line that was cut off."""
    rows: dict[str, Row] = {}
    text = place.read_text(encoding="utf-8") if place.exists() else ""
    for line in text.splitlines(keepends=True):
        if line.endswith("\n"):
            row = Row(**json.loads(line))
            rows[row.name] = row
    return list(rows.values())
