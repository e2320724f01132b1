"""Statuses: which one counts, and sums of counts."""

from __future__ import annotations

import json

import pytest
import torch

from spmm_torch.solvers.status import Solver, Status, StatusCounts, count_by_status, worst_status


def statuses(*values: Status) -> torch.Tensor:
    return torch.tensor(values, dtype=torch.int8)


def test_the_worst_status_that_holds_counts() -> None:
    converged = torch.tensor([True, False, True, True])
    no_descent = torch.tensor([False, False, True, True])
    not_finite = torch.tensor([False, False, False, True])
    status = worst_status(converged, no_descent, not_finite)
    assert status.dtype == torch.int8
    assert status.tolist() == [
        Status.CONVERGED,
        Status.LIMIT,
        Status.NO_DESCENT,
        Status.NOT_FINITE,
    ]


def test_counts_of_parts_add_up_to_those_of_the_whole() -> None:
    status = torch.randint(0, 4, (7, 3), generator=torch.Generator().manual_seed(0)).to(torch.int8)
    whole = StatusCounts.of(Solver.FOBA, status)
    parts = (StatusCounts.of(Solver.FOBA, part) for part in status.split(2))
    assert torch.equal(sum(parts, StatusCounts.none()).table, whole.table)
    expected = [int((status == kind).sum()) for kind in Status]
    assert list(whole.to_dict()["foba"].values()) == count_by_status(status).tolist() == expected


def test_solvers_do_not_mix() -> None:
    both = StatusCounts.of(Solver.NNLS, statuses(Status.LIMIT, Status.CONVERGED))
    both = both + StatusCounts.of(Solver.KMEANS, Status.CONVERGED)
    counts = both.to_dict()
    assert list(counts) == [
        "nnls",
        "stagewise_lasso",
        "foba",
        "lbfgs",
        "adam",
        "varpro",
        "kmeans",
        "sparse_nnls",
    ]
    assert counts["nnls"] == {"converged": 1, "limit": 1, "no_descent": 0, "not_finite": 0}
    assert counts["kmeans"] == {"converged": 1, "limit": 0, "no_descent": 0, "not_finite": 0}
    assert sum(counts["varpro"].values()) == 0
    assert json.loads(json.dumps(counts)) == counts


def test_no_problems_count_as_none() -> None:
    empty = StatusCounts.of(Solver.NNLS, torch.zeros(0, 3, dtype=torch.int8))
    assert torch.equal(empty.table, StatusCounts.none().table)


@pytest.mark.gpu
def test_a_running_sum_stays_on_the_device() -> None:
    counts = StatusCounts.none() + StatusCounts.of(Solver.LBFGS, statuses(Status.LIMIT).cuda())
    assert counts.table.is_cuda
    assert counts.to("cpu").to_dict()["lbfgs"]["limit"] == 1
