"""Counts of what a device was asked: operations, waits of the host, bytes moved."""

from __future__ import annotations

import sys
import sysconfig
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path

TO_DEVICE, TO_HOST = "to device", "to host"
# Lines of this folder, of Python and of installed packages ask on behalf of others; those of this
# package ask for themselves, wherever it is installed.
SIMULATION = str(Path(__file__).parent)
PACKAGE = str(Path(__file__).parents[2])
OTHERS = tuple(sysconfig.get_path(name) for name in ("stdlib", "purelib", "platlib"))


@dataclass
class Tally:
    """What a simulated device was asked.

    Attributes:
        launches: operations that launch work, by name.
        lines: the same by "folder/file:line"; empty unless `by_line`.
        waits: how often the host waited for the device, by "folder/file:line cause".
        moved: bytes that crossed the bus, by way.
        by_line: whether lines of launches are noted, which takes time.
    """

    launches: Counter[str] = field(default_factory=Counter)
    lines: Counter[str] = field(default_factory=Counter)
    waits: Counter[str] = field(default_factory=Counter)
    moved: Counter[str] = field(default_factory=Counter)
    by_line: bool = False

    def launch(self, name: str) -> None:
        """Counts an operation that launches work."""
        self.launches[name] += 1
        if self.by_line:
            self.lines[asking_line()] += 1

    def wait(self, cause: str) -> None:
        """Counts a wait of the host at the line of the project that causes it."""
        self.waits[f"{asking_line()} {cause}"] += 1

    def move(self, way: str, size: int) -> None:
        """Counts bytes over the bus; the host waits, since its memory is not pinned."""
        self.moved[way] += size
        self.wait(way)


def asking_line() -> str:
    """The innermost line, as "folder/file:line", that is not of a library or of this simulation."""
    frame = sys._getframe(1)
    while frame is not None:
        name = frame.f_code.co_filename
        if _asks(name):
            return f"{'/'.join(Path(name).parts[-2:])}:{frame.f_lineno}"
        frame = frame.f_back
    return "elsewhere"


def _asks(name: str) -> bool:
    """Whether a line of a file asks for itself."""
    if name.startswith(PACKAGE):
        return not name.startswith(SIMULATION)
    return not name.startswith(("<", *OTHERS))
