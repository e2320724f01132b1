"""What a whole run carries: device, randomness, processes, time, progress, state and memory."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path

import torch

from .checkpoint import Checkpoint, S, stage_generator
from .device import resolve_device
from .memory import Budget
from .progress import Progress, Stage
from .ranks import ALONE, Ranks, local_count
from .stopwatch import Stopwatch

SILENT = Progress(enabled=False)


@dataclass(frozen=True)
class Context:
    """What every stage of a run is given beside its data; only `device` and `seed` change results.

    Attributes:
        device: on which to work.
        seed: of every random choice.
        watch: tells the time by stage.
        budget: of memory.
        progress: who is told how far the run is; nobody by default.
        ranks: the processes that share the run; all of them call every stage.
        state: folder in which finished stages are kept, to go on from; None: nowhere.
        cache: folder for decoded values; None: the user's own, only for what exceeds the memory.
    """

    device: torch.device
    seed: int
    watch: Stopwatch
    budget: Budget = field(default_factory=Budget.build)
    progress: Progress = SILENT
    ranks: Ranks = ALONE
    state: Path | None = None
    cache: Path | None = None

    @classmethod
    def build(
        cls,
        device: str = "auto",
        seed: int = 0,
        *,
        memory: int | None = None,
        watch: Stopwatch | None = None,
        progress: Progress = SILENT,
        ranks: Ranks = ALONE,
        state: Path | None = None,
        cache: Path | None = None,
    ) -> Context:
        """The context of a run.

        Args:
            device: as `FitConfig.device` names it.
            seed: of every random choice.
            memory: bytes that the process may take; None: half of what is free.
            watch: None: one of its own.
            progress, ranks, state, cache: see the attributes.

        Raises:
            ConfigError: the device is not there.
        """
        where = resolve_device(device)
        budget = Budget.build(memory, processes=local_count())
        watch = watch or Stopwatch(where)
        return cls(where, seed, watch, budget, progress, ranks, state, cache)

    def generator(self, stage: str) -> torch.Generator:
        """The source of randomness of one stage."""
        return stage_generator(self.seed, stage)

    def once(self, name: str, kind: type[S], compute: Callable[[], S]) -> S:
        """The result of a piece of work: read if it is kept, else computed and kept."""
        return Checkpoint(self.watch, self.state, self.ranks).once(name, kind, compute)

    def stage(
        self,
        name: str,
        kind: type[S],
        compute: Callable[[Stage], S],
        total: int,
        unit: str,
        timed: str | None = None,
    ) -> S:
        """The result of a stage: read if it is kept, else computed, timed, told and kept.

        Args:
            name: of the stage.
            kind: class of the result.
            compute: makes the result and calls its argument with units done.
            total, unit: how many units there are, and what is counted, in the plural.
            timed: name under which the seconds count; None: that of the stage.
        """

        def work() -> S:
            with self.watch(timed or name):
                return compute(advance)

        with self.progress.stage(name, total, unit) as advance:
            return self.once(name, kind, work)

    def one_of(self, count: int) -> Context:
        """The context of one of `count` pieces of work that run side by side."""
        return replace(self, watch=self.watch.one_of(count))
