"""How solvers end: a status for each problem, and counts by solver and status.

Every solver returns the status of each problem of its batch, as BoTorch (`OptimizationStatus`) and
skglm (stop criterion) do. Counts stay on the device until they are read.
"""

from __future__ import annotations

import operator
from collections.abc import Iterable
from dataclasses import dataclass
from enum import IntEnum
from functools import reduce

import torch
from torch import Tensor

# Signed, because PyTorch takes an index of type uint8 for a mask.
STATUS_DTYPE = torch.int8


class Status(IntEnum):
    """End of one problem, from best to worst: the larger of two is the worse one.

    Attributes:
        CONVERGED: the stopping rule holds, or after progress no step lowers the value any more.
        LIMIT: a limit of steps or of atoms ended the problem.
        NO_DESCENT: no step from the start lowers the value, or none can be computed.
        NOT_FINITE: an input, a value or a gradient was NaN or infinite.
    """

    CONVERGED = 0
    LIMIT = 1
    NO_DESCENT = 2
    NOT_FINITE = 3


class Solver(IntEnum):
    """Solvers whose problems are counted; the lower-case name is the key of a report."""

    NNLS = 0
    STAGEWISE_LASSO = 1
    FOBA = 2
    LBFGS = 3
    ADAM = 4
    VARPRO = 5
    KMEANS = 6
    SPARSE_NNLS = 7


def worst_status(converged: Tensor, no_descent: Tensor, not_finite: Tensor) -> Tensor:
    """The worst status that holds for each problem; LIMIT where none of them does.

    Args:
        converged: `[B]` bool, like the others.
        no_descent: whether no step went down.
        not_finite: whether a value was NaN or infinite.

    Returns:
        Status `[B]` int8.
    """
    status = torch.full_like(converged, Status.LIMIT, dtype=STATUS_DTYPE)
    status = status.masked_fill(converged, Status.CONVERGED)
    status = status.masked_fill(no_descent, Status.NO_DESCENT)
    return status.masked_fill(not_finite, Status.NOT_FINITE)


def count_by_status(status: Tensor) -> Tensor:
    """Problems of each status, `[4]` long, given `status [...]`; the host does not wait."""
    kinds = torch.arange(len(Status), device=status.device)
    return (status.reshape(-1, 1) == kinds).sum(0)


@dataclass(frozen=True)
class StatusCounts:
    """Problems by solver and status; counts of several blocks, threads or ranks can be added.

    Attributes:
        table: rows in the order of `Solver`, columns in that of `Status`, `[8, 4]` long.
    """

    table: Tensor

    @classmethod
    def none(cls) -> StatusCounts:
        """No problems yet, on the CPU."""
        return cls(torch.zeros(len(Solver), len(Status), dtype=torch.long))

    @classmethod
    def of(cls, solver: Solver, status: Tensor | Status) -> StatusCounts:
        """Counts of the problems of one solver, on the device of `status`.

        Args:
            solver: that solved them.
            status: int8 `[...]`, or that of a single problem.
        """
        if isinstance(status, Status):
            status = torch.tensor(status, dtype=STATUS_DTYPE)
        table = torch.zeros(len(Solver), len(Status), dtype=torch.long, device=status.device)
        table[solver] = count_by_status(status)
        return cls(table)

    def to(self, device: torch.device | str) -> StatusCounts:
        """The same counts on another device."""
        return StatusCounts(self.table.to(device))

    def __add__(self, other: StatusCounts) -> StatusCounts:
        """The sum on the device of `other`, so that a running sum does not wait for that device."""
        return StatusCounts(self.table.to(other.table.device) + other.table)

    @classmethod
    def sum(cls, parts: Iterable[StatusCounts]) -> StatusCounts:
        """The sum of all parts, on the device of the last one."""
        return reduce(operator.add, parts, cls.none())

    def to_dict(self) -> dict[str, dict[str, int]]:
        """Counts by the lower-case names of solver and status; the host waits for the device."""
        rows: list[list[int]] = self.table.tolist()
        names = [status.name.lower() for status in Status]
        return {
            solver.name.lower(): dict(zip(names, rows[solver], strict=True)) for solver in Solver
        }
