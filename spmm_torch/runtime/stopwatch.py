"""Seconds by stage."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from time import perf_counter
from typing import Self

import torch


@dataclass
class Stopwatch:
    """Adds up the time spent in named stages; on a GPU, work still queued is waited for.

    Attributes:
        device: where the work runs.
        seconds: by stage.
        share: of every second that counts, where other work runs at the same time.
    """

    device: torch.device
    seconds: dict[str, float] = field(default_factory=dict)
    share: float = 1.0

    @contextmanager
    def __call__(self, stage: str) -> Iterator[None]:
        start = self._now()
        try:
            yield
        finally:
            self._add(stage, self.share * (self._now() - start))

    def one_of(self, count: int) -> Self:
        """A watch for one of `count` pieces of work that run side by side."""
        return type(self)(self.device, share=self.share / count)

    def take(self, other: Stopwatch) -> None:
        """Adds what another watch has."""
        for stage, spent in other.seconds.items():
            self._add(stage, spent)

    def _add(self, stage: str, spent: float) -> None:
        self.seconds[stage] = self.seconds.get(stage, 0.0) + spent

    def _now(self) -> float:
        if self.device.type == "cuda":
            torch.cuda.synchronize(self.device)
        return perf_counter()
