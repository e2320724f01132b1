"""Wall-clock seconds by stage."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from time import perf_counter
from typing import Self

import torch


@dataclass(eq=False)
class _Block:
    """A block of code whose seconds up to `since` have been added to those of its stage."""

    stage: str
    since: float


@dataclass
class Stopwatch:
    """Adds up the time spent in named stages; on a GPU it waits for queued work.

    Attributes:
        device: device of the work.
        seconds: seconds by stage.
        fraction: fraction of every second that counts; below 1 beside work that runs meanwhile.
    """

    device: torch.device
    seconds: dict[str, float] = field(default_factory=dict)
    fraction: float = 1.0
    _running: list[_Block] = field(default_factory=list, repr=False)

    @contextmanager
    def __call__(self, stage: str) -> Iterator[None]:
        """Times the block under `with` as part of a stage."""
        block = _Block(stage, perf_counter())  # no work is queued: the last block has waited
        self._running.append(block)
        try:
            yield
        finally:
            self.count_up()
            self._running.remove(block)

    def count_up(self) -> None:
        """Adds what the running blocks have taken so far to the seconds of their stages."""
        self._wait()
        now = perf_counter()
        for block in self._running:
            self._add(block.stage, self.fraction * (now - block.since))
            block.since = now

    def one_of(self, count: int) -> Self:
        """A stopwatch for one of `count` pieces of work that run at the same time."""
        return type(self)(self.device, fraction=self.fraction / count)

    def take(self, other: Stopwatch) -> None:
        """Adds the seconds of another stopwatch."""
        for stage, spent in other.seconds.items():
            self._add(stage, spent)

    def _add(self, stage: str, spent: float) -> None:
        self.seconds[stage] = self.seconds.get(stage, 0.0) + spent

    def _wait(self) -> None:
        """Waits for queued work."""
        if self.device.type == "cuda":
            torch.cuda.synchronize(self.device)
