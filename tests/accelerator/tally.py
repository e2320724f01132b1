"""Counts of what a device was asked: operations, waits of the host, bytes moved."""

from __future__ import annotations

import sys
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path

from tests.locations import ROOT

TO_DEVICE, TO_HOST = "to device", "to host"
PROJECT = str(ROOT)
# Folders whose lines ask on behalf of others: those of this simulation, and installed packages.
BETWEEN = (str(Path(__file__).parent), str(ROOT / ".venv"))
TESTS = str(Path(__file__).parent / "test_")


@dataclass
class Tally:
    """What a simulated device was asked.

    Attributes:
        launches: operations that launch work, by name.
        waits: how often the host waited for the device, by "folder/file:line cause".
        moved: bytes that crossed the bus, by way.
    """

    launches: Counter[str] = field(default_factory=Counter)
    waits: Counter[str] = field(default_factory=Counter)
    moved: Counter[str] = field(default_factory=Counter)

    def wait(self, cause: str) -> None:
        """Counts a wait of the host at the line of the project that causes it."""
        self.waits[f"{asking_line()} {cause}"] += 1

    def move(self, way: str, size: int) -> None:
        """Counts bytes over the bus; the host waits, since its memory is not pinned."""
        self.moved[way] += size
        self.wait(way)


def asking_line() -> str:
    """The innermost line, as "folder/file:line", of the package or of a test."""
    frame = sys._getframe(1)
    while frame is not None:
        name = frame.f_code.co_filename
        if name.startswith(PROJECT) and (not name.startswith(BETWEEN) or name.startswith(TESTS)):
            return f"{'/'.join(Path(name).parts[-2:])}:{frame.f_lineno}"
        frame = frame.f_back
    return "elsewhere"
