"""Several starts of the same problems: the best one, and counts of how they ended."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import reduce

import torch
from torch import Tensor

from .status import Solver, Status, StatusCounts, count_by_status


def best_start(value: Tensor) -> Tensor:
    """The start of least value `[S]`, of R starts of S problems with `value [R, S]`.

    NaN counts as the largest value; `argmin` would take it for the least.
    """
    return torch.where(value.isnan(), torch.inf, value).argmin(0)


@dataclass
class StartCounts:
    """Counts of the starts of a search by status, and of all problems that its solvers had.

    Attributes:
        solvers: problems by solver and status.
        starts: starts by status, `[4]` long. A start that several solvers follow has the worst
            status of theirs.
    """

    solvers: StatusCounts = field(default_factory=StatusCounts.none)
    starts: Tensor = field(default_factory=lambda: torch.zeros(len(Status), dtype=torch.long))

    def add_problems(self, solver: Solver, status: Tensor) -> None:
        """Counts problems that are not starts, by their `status [...]`."""
        self.solvers = self.solvers + StatusCounts.of(solver, status)

    def add_starts(self, statuses: Mapping[Solver, Tensor]) -> None:
        """Counts R starts, and their problems, by the statuses `[R]` of the solvers they met."""
        for solver, status in statuses.items():
            self.add_problems(solver, status)
        worst = reduce(torch.maximum, statuses.values())
        self.starts = self.starts.to(worst.device) + count_by_status(worst)

    def to_tensor(self) -> Tensor:
        """`[3]` on the CPU: all starts, those NOT_FINITE, and those that ended NO_DESCENT."""
        by_status: list[int] = self.starts.tolist()
        return torch.tensor(
            [sum(by_status), by_status[Status.NOT_FINITE], by_status[Status.NO_DESCENT]]
        )
