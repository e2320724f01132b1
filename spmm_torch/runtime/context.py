"""The context of a run: device, randomness, processes, time, progress, state and memory."""

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
    """What every stage needs besides its data; only `device` and `seed` change results.

    Attributes:
        device: device to compute on.
        seed: seed of every random choice.
        watch: stopwatch of the stages.
        budget: memory that the run may take.
        progress: receiver of the progress; silent by default.
        ranks: processes that share the run; all of them call every stage.
        state: folder for the results of finished stages, from which a run resumes; None: none.
        cache: folder for decoded values; None: the user's cache folder, and only for a BTF that
            exceeds the memory.
        depends_on: key of all that finished stages depend on; a state with another is made anew.
    """

    device: torch.device
    seed: int
    watch: Stopwatch
    budget: Budget = field(default_factory=Budget.build)
    progress: Progress = SILENT
    ranks: Ranks = ALONE
    state: Path | None = None
    cache: Path | None = None
    depends_on: str = ""

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
        depends_on: str = "",
    ) -> Context:
        """The context of a run.

        Args:
            device: name of the device, as in `FitConfig.device`.
            seed: seed of every random choice.
            memory: bytes that the process may take; None: half of the free memory.
            watch: stopwatch of the stages; None: a new one.
            progress, ranks, state, cache, depends_on: see the attributes.

        Raises:
            ConfigError: there is no such device.
        """
        where = resolve_device(device)
        budget = Budget.build(memory, processes=local_count())
        watch = watch or Stopwatch(where)
        return cls(where, seed, watch, budget, progress, ranks, state, cache, depends_on)

    def generator(self, stage: str) -> torch.Generator:
        """The random generator of one stage, on the CPU."""
        return stage_generator(self.seed, stage)

    def once(self, name: str, kind: type[S], compute: Callable[[], S]) -> S:
        """The result of a piece of work: read if it was kept, else computed and kept.

        Raises:
            OSError: the result cannot be written.
        """
        kept = Checkpoint(self.watch, self.state, self.ranks, self.depends_on, self.progress.say)
        return kept.once(name, kind, compute)

    def stage(
        self,
        name: str,
        kind: type[S],
        compute: Callable[[Stage], S],
        total: int,
        unit: str,
        timed: str | None = None,
    ) -> S:
        """The result of a stage: read if it was kept, else computed, timed and kept.

        Args:
            name: name of the stage.
            kind: class of the result.
            compute: function that computes the result, and calls its argument with the number of
                units that are newly done.
            total: number of units.
            unit: what is counted, in the plural.
            timed: name of the stage on the stopwatch; None: `name`.

        Raises:
            OSError: the result cannot be written.
        """

        def work() -> S:
            with self.watch(timed or name):
                return compute(advance)

        with self.progress.stage(name, total, unit) as advance:
            return self.once(name, kind, work)

    def one_of(self, count: int) -> Context:
        """The context of one of `count` pieces of work that run at the same time."""
        return replace(self, watch=self.watch.one_of(count))
