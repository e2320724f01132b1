"""One table of all that was measured, for people."""

from __future__ import annotations

from typing import Any

from tests.benchmarks.on_gpu.child import Ended
from tests.benchmarks.on_gpu.parts import COPY, PRODUCT
from tests.benchmarks.on_gpu.rows import Row

HEAD = ("", "seconds", "TFLOP/s", "of product", "GB/s", "of copy", "peak MB", "")
WIDTHS = (46, 9, 9, 11, 9, 8, 9, 0)


def table(environment: dict[str, Any], ended: dict[str, Ended]) -> str:
    """The table, with the name of the device above and failures as their own lines."""
    versions = ", ".join(f"{name} {value}" for name, value in environment["versions"].items())
    lines = [f"{environment['device']}, {environment['cpu']}", versions, "", _line(HEAD)]
    known = {row.name: row for found in ended.values() for row in found.rows}
    rate = {"flops": _rate(known.get(PRODUCT), "flops"), "bytes": _rate(known.get(COPY), "bytes")}
    for part, found in ended.items():
        lines += [_line(_cells(row, rate)) for row in found.rows]
        if found.failure:
            lines.append(f"{part} FAILED: {found.failure}")
    return "\n".join(lines)


def _cells(row: Row, limits: dict[str, float | None]) -> tuple[str, ...]:
    cells = [row.name, "" if row.seconds is None else f"{row.seconds:.4g}"]
    for kind, unit, digits in (("flops", 1e12, 3), ("bytes", 1e9, 1)):
        reached, limit = _rate(row, kind), limits[kind]
        cells.append("" if reached is None else f"{reached / unit:.{digits}f}")
        cells.append(f"{100 * reached / limit:.1f} %" if reached is not None and limit else "")
    peak = "" if row.peak is None else f"{row.peak / 1e6:,.0f}"
    return (*cells, peak, row.note)


def _rate(row: Row | None, kind: str) -> float | None:
    """Work in a second; None where it was not counted or not timed."""
    work = None if row is None else getattr(row, kind)
    return work / row.seconds if row is not None and work and row.seconds else None


def _line(cells: tuple[str, ...]) -> str:
    first, *rest = (cell.rjust(width) for cell, width in zip(cells, WIDTHS, strict=True))
    return " ".join([cells[0].ljust(WIDTHS[0]), *rest[:-1], cells[-1]]).rstrip()
