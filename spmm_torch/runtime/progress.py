"""Progress of long stages: a bar with the time left on a terminal, plain lines elsewhere."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TextIO

from tqdm import tqdm

from .lasting import lasting

Advance = Callable[[int], None]  # called with the number of units that are newly done
# Seconds between two plain lines: a log stays short, and a stalled run is noticed.
LINE_INTERVAL = 10.0
MINUTE, HOUR = 60, 3600  # seconds
# Format of tqdm for a stage without a total.
OPEN_BAR = "{desc}: {n_fmt}{unit} [{elapsed}]"


class Progress:
    """Reports the progress of a run.

    Args:
        stream: stream to write to; None: standard error.
        enabled: False keeps the stream silent, for use as a library; the log is still written.
        log: file to which every plain line is appended; its folder must exist.
        interval: seconds between two plain lines of a stage.
        clock: function that gives seconds from any origin.
    """

    def __init__(
        self,
        stream: TextIO | None = None,
        enabled: bool = True,
        log: Path | None = None,
        *,
        interval: float = LINE_INTERVAL,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self.stream = lasting(sys.stderr if stream is None else stream)
        self.enabled = enabled
        self.log = log
        self.interval = interval
        self.clock = clock

    @property
    def on_terminal(self) -> bool:
        """Whether a bar is shown instead of plain lines."""
        return self.enabled and self.stream.isatty()

    def say(self, text: str) -> None:
        """Writes one line; an open bar stays below it."""
        if self.on_terminal:
            tqdm.write(text, file=self.stream)
        self.write_line(text)

    @contextmanager
    def stage(self, name: str, total: int | None = None, unit: str = "") -> Iterator[Stage]:
        """One stage of `total` units; yields the function that counts them: `advance(8)`.

        Args:
            name: name of the stage.
            total: number of units; None if not known.
            unit: what is counted, in the plural.
        """
        stage = Stage(self, name, total, unit)
        stage.begin()
        outcome = "stopped after"
        try:
            yield stage
            outcome = "done in"
        finally:
            stage.end(outcome)

    def write_line(self, text: str) -> None:
        """Writes a plain line to the log, and to the stream unless it is a terminal."""
        if self.enabled and not self.on_terminal:
            print(text, file=self.stream, flush=True)
        if self.log is not None:
            # Opened for every line, so that the folder of a run can be renamed meanwhile.
            with self.log.open("a", encoding="utf-8", errors="backslashreplace") as file:
                file.write(text + "\n")


class Stage:
    """Counts the units of one stage; made by `Progress.stage`."""

    def __init__(self, progress: Progress, name: str, total: int | None, unit: str) -> None:
        self.progress = progress
        self.name = name
        self.total = total
        self.unit = unit
        self.done = 0
        self._started = self._last_line = progress.clock()
        self._bar: tqdm | None = None

    def __call__(self, count: int = 1) -> None:
        """Counts `count` more units as done."""
        self.done += count
        if self._bar is not None:
            self._bar.update(count)
        now = self.progress.clock()
        if now - self._last_line >= self.progress.interval:
            self._last_line = now
            self.progress.write_line(f"{self.name}: {self._state(now - self._started)}")

    def to(self, done: int, total: int | None = None) -> None:
        """Sets the number of units done so far and, if given, their total; for `BTF.load`."""
        if total is not None and total != self.total:
            self.total = total
            if self._bar is not None:
                self._bar.total = total
        self(done - self.done)

    def begin(self) -> None:
        """Opens the bar, or writes the first line."""
        if self.progress.on_terminal:
            self._bar = tqdm(
                total=self.total,
                desc=self.name,
                unit=f" {self.unit}" if self.unit else "",
                file=self.progress.stream,
                dynamic_ncols=True,
                bar_format=None if self.total else OPEN_BAR,
            )
        self.progress.write_line(
            f"{self.name}: {self._count(self.total)}" if self.total else f"{self.name}: started"
        )

    def end(self, outcome: str) -> None:
        """Closes the bar and writes the last line: `outcome` and the seconds taken."""
        if self._bar is not None:
            self._bar.close()
        seconds = self.progress.clock() - self._started
        self.progress.write_line(f"{self.name}: {outcome} {seconds:.1f} s")

    def _state(self, elapsed: float) -> str:
        if not self.total:
            return f"{self._count(self.done)} after {duration(elapsed)}"
        percentage = min(100.0 * self.done / self.total, 100.0)
        text = f"{percentage:.0f} % ({self.done} of {self._count(self.total)})"
        if self.done:
            left = elapsed * max(self.total - self.done, 0) / self.done
            text += f", {duration(left)} left"
        return text

    def _count(self, count: int | None) -> str:
        unit = self.unit.removesuffix("s") if count == 1 else self.unit
        return f"{count} {unit}".rstrip()


def duration(seconds: float) -> str:
    """A duration as text, such as `42 s`, `3 min 05 s` or `1 h 02 min`."""
    whole = round(seconds)
    if whole < MINUTE:
        return f"{whole} s"
    if whole < HOUR:
        return f"{whole // MINUTE} min {whole % MINUTE:02d} s"
    return f"{whole // HOUR} h {whole % HOUR // MINUTE:02d} min"
