"""Choice of the best start, and the count of how starts ended."""

from __future__ import annotations

import torch

from spmm_torch.solvers.multistart import StartCounts, best_start
from spmm_torch.solvers.status import Solver, Status


def test_takes_the_least_value_and_never_nan() -> None:
    value = torch.tensor([[3.0, torch.nan], [1.0, 5.0], [2.0, torch.inf]])
    assert best_start(value).tolist() == [1, 1]


def test_a_start_counts_once_by_the_worst_of_its_solvers() -> None:
    counts = StartCounts()
    adam = torch.tensor([Status.LIMIT, Status.NOT_FINITE, Status.LIMIT], dtype=torch.int8)
    lbfgs = torch.tensor([Status.CONVERGED, Status.NO_DESCENT, Status.NO_DESCENT]).to(adam)
    counts.add_starts({Solver.ADAM: adam, Solver.LBFGS: lbfgs})
    counts.add_starts({Solver.LBFGS: torch.tensor([Status.CONVERGED]).to(adam)})
    assert counts.to_tensor().tolist() == [4, 1, 1]
    by_solver = counts.solvers.to_dict()
    assert by_solver["adam"] == {"converged": 0, "limit": 2, "no_descent": 0, "not_finite": 1}
    assert by_solver["lbfgs"] == {"converged": 2, "limit": 0, "no_descent": 2, "not_finite": 0}


def test_what_is_no_start_counts_by_solver_only() -> None:
    counts = StartCounts()
    counts.add_problems(Solver.NNLS, torch.zeros(5, 3, dtype=torch.int8))
    assert counts.to_tensor().tolist() == [0, 0, 0]
    assert counts.solvers.to_dict()["nnls"]["converged"] == 15
