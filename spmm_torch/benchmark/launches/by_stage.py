"""What each stage of a fit asks of a simulated device."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Self

from ...runtime.stopwatch import Stopwatch
from .tally import TO_DEVICE, TO_HOST, Tally


@dataclass(frozen=True)
class Asked:
    """Counts of one stage.

    Attributes:
        launches: operations that launch work.
        waits: how often the host waited for the device.
        bytes_to_device, bytes_to_host: that crossed the bus.
    """

    launches: int = 0
    waits: int = 0
    bytes_to_device: int = 0
    bytes_to_host: int = 0

    @classmethod
    def so_far(cls, tally: Tally) -> Asked:
        """All that a device was asked until now."""
        moved = tally.moved
        return cls(tally.launches.total(), tally.waits.total(), moved[TO_DEVICE], moved[TO_HOST])

    def __add__(self, other: Asked) -> Asked:
        return Asked(**{name: value + getattr(other, name) for name, value in vars(self).items()})

    def __sub__(self, other: Asked) -> Asked:
        return Asked(**{name: value - getattr(other, name) for name, value in vars(self).items()})


@dataclass
class TallyWatch(Stopwatch):
    """A stopwatch that also tells what each stage asks; reading it makes no host wait.

    Attributes:
        tally: of the device.
        asked: by stage.
    """

    tally: Tally = field(default_factory=Tally)
    asked: defaultdict[str, Asked] = field(default_factory=lambda: defaultdict(Asked))

    def one_of(self, count: int) -> Self:
        """A watch of the same device for one of `count` pieces of work; see `Stopwatch.one_of`."""
        return type(self)(self.device, fraction=self.fraction / count, tally=self.tally)

    def take(self, other: Stopwatch) -> None:
        """Adds the seconds and counts of another watch."""
        super().take(other)
        if isinstance(other, TallyWatch):
            for stage, asked in other.asked.items():
                self.asked[stage] += asked

    @contextmanager
    def __call__(self, stage: str) -> Iterator[None]:
        """One stage, or a part of it."""
        before = Asked.so_far(self.tally)
        try:
            with super().__call__(stage):
                yield
        finally:
            self.asked[stage] += Asked.so_far(self.tally) - before

    def _wait(self) -> None:
        """Does not wait: the simulated device is never behind."""
