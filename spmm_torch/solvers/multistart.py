"""Several starts of the same problems: which one is best, and how they ended."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import reduce

import torch
from torch import Tensor

from .status import Solver, Status, StatusCounts, count_by_status


def best_start(value: Tensor) -> Tensor:
    """Which of R starts has the least value, for each of S problems: `value [R, S]` to `[S]`.

    NaN, which `argmin` would take for the least of all, counts as the worst.
    """
    return torch.where(value.isnan(), torch.inf, value).argmin(0)


@dataclass
class StartTally:
    """How the starts of a search ended, and every problem that its solvers had.

    Attributes:
        solvers: problems by solver and status.
        starts: starts by status, `[4]` long; the worst counts where several solvers follow one
            start.
    """

    solvers: StatusCounts = field(default_factory=StatusCounts.none)
    starts: Tensor = field(default_factory=lambda: torch.zeros(len(Status), dtype=torch.long))

    def count(self, solver: Solver, status: Tensor) -> None:
        """Counts problems that are no starts, by their `status` of any shape."""
        self.solvers = self.solvers + StatusCounts.of(solver, status)

    def add(self, statuses: Mapping[Solver, Tensor]) -> None:
        """Counts R starts by the statuses `[R]` of all solvers that followed them."""
        for solver, status in statuses.items():
            self.count(solver, status)
        worst = reduce(torch.maximum, statuses.values())
        self.starts = self.starts.to(worst.device) + count_by_status(worst)

    def to_tensor(self) -> Tensor:
        """How many starts there were, how many met NaN or infinity, and from how many no step
        went down: `[3]` on the CPU.
        """
        by_status: list[int] = self.starts.tolist()
        return torch.tensor(
            [sum(by_status), by_status[Status.NOT_FINITE], by_status[Status.NO_DESCENT]]
        )
