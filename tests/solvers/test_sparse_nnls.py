"""Sparse non-negative least squares against scipy and its own optimality conditions."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import nnls
from torch import Tensor

from spmm_torch.runtime.sparse import csr_matrix
from spmm_torch.solvers.sparse_nnls import Conditions, SparseNNLSResult, sparse_nnls
from spmm_torch.solvers.status import Status

# Of values in float64: steps go down as long as the value tells, which is to its square root.
TOLERANCE = 1e-7


def sparse(matrix: Tensor) -> Tensor:
    rows, columns = matrix.nonzero(as_tuple=True)
    count = torch.bincount(rows, minlength=len(matrix))
    offset = torch.cat((count.new_zeros(1), count.cumsum(0)))
    return csr_matrix(offset, columns, matrix[rows, columns], (len(matrix), len(matrix)))


def problem(atoms: int, channels: int, seed: int = 0) -> tuple[Tensor, Tensor]:
    """Atoms `[rows, N]`, each of which overlaps few others, and targets `[rows, C]`."""
    generator = torch.Generator().manual_seed(seed)
    design = torch.zeros(3 * atoms + 6, atoms, dtype=torch.float64)
    for column in range(atoms):
        own = torch.randn(8, generator=generator, dtype=torch.float64)
        design[3 * column : 3 * column + 8, column] = own
    size = 0.1 + torch.rand(atoms, generator=generator, dtype=torch.float64)
    target = torch.randn(len(design), channels, generator=generator, dtype=torch.float64)
    return design * size, target


def solved(
    design: Tensor, target: Tensor, start: Tensor | None = None, steps: int = 400
) -> SparseNNLSResult:
    gram, rhs = design.T @ design, design.T @ target
    start = torch.zeros_like(rhs) if start is None else start
    found = sparse_nnls(sparse(gram), gram.diagonal(), rhs, start, steps=steps, tolerance=TOLERANCE)
    torch.testing.assert_close(found.gradient, gram @ found.weights - rhs, atol=1e-9, rtol=0)
    return found


def error(design: Tensor, target: Tensor, weights: Tensor) -> Tensor:
    return (design @ weights - target).square().sum(0)


def kkt(design: Tensor, target: Tensor, weights: Tensor) -> Tensor:
    gram, rhs = design.T @ design, design.T @ target
    diagonal = gram.diagonal()
    inverse = torch.where(diagonal > 0.0, 1.0 / diagonal, 0.0)[:, None]
    return Conditions.of(rhs, inverse).violation(weights, gram @ weights - rhs)


@pytest.mark.parametrize("channels", [1, 3])
@pytest.mark.parametrize("atoms", [1, 2, 40])
def test_equals_scipy(atoms: int, channels: int) -> None:
    design, target = problem(atoms, channels)
    found = solved(design, target)
    assert (found.status == Status.CONVERGED).all()
    assert float(kkt(design, target, found.weights).max()) <= TOLERANCE
    expected = [nnls(design.numpy(), column)[0] for column in target.T.numpy()]
    np.testing.assert_allclose(found.weights.numpy(), np.stack(expected, axis=1), atol=1e-5)


def test_violation_sees_a_wrong_answer() -> None:
    design, target = problem(12, 2)
    found = solved(design, target).weights
    assert float(kkt(design, target, found + 0.1).min()) > 1e-3
    assert float(kkt(design, target, 0.5 * found).min()) > 1e-3


@given(st.integers(0, 2**16), st.integers(0, 12))
def test_never_worse_than_the_start(seed: int, steps: int) -> None:
    design, target = problem(15, 2, seed)
    generator = torch.Generator().manual_seed(seed)
    start = torch.randn(15, 2, generator=generator, dtype=torch.float64).clamp(min=0.0)
    found = solved(design, target, start, steps).weights
    assert (found >= 0.0).all()
    before, after = (error(design, target, weights) for weights in (start, found))
    assert (after <= before * (1.0 + 1e-12)).all()


def test_more_steps_are_never_worse() -> None:
    design, target = problem(30, 3)
    errors = [error(design, target, solved(design, target, steps=n).weights) for n in range(20)]
    changes = torch.stack(errors).diff(dim=0)
    assert (changes <= 1e-12).all() and (changes[0] < -1e-3).all()


def test_no_steps_leave_the_start() -> None:
    design, target = problem(6, 2)
    start = torch.ones(6, 2, dtype=torch.float64)
    found = solved(design, target, start, steps=0)
    assert torch.equal(found.weights, start)
    assert (found.status == Status.LIMIT).all()


def test_the_solution_is_left_alone() -> None:
    design, target = problem(20, 2)
    best = solved(design, target).weights
    again = solved(design, target, best, steps=0)
    assert torch.equal(again.weights, best)
    assert (again.status == Status.CONVERGED).all()


def test_zero_products() -> None:
    design, target = problem(8, 2)
    target[:, 1] = 0.0
    found = solved(design, target)
    assert (found.weights[:, 1] == 0.0).all()
    assert (found.status == Status.CONVERGED).all()
    fallen = solved(design, target, torch.ones(8, 2, dtype=torch.float64)).weights
    assert float(fallen[:, 1].max()) < 1e-6


def test_atoms_that_are_zero_stay_where_they_are() -> None:
    design, target = problem(10, 2)
    design[:, [0, 4]] = 0.0
    start = torch.full((10, 2), 0.3, dtype=torch.float64)
    found = solved(design, target, start)
    assert (found.status == Status.CONVERGED).all()
    assert (found.weights[[0, 4]] == 0.3).all()
    expected = [nnls(np.delete(design.numpy(), (0, 4), 1), y)[0] for y in target.T.numpy()]
    others = np.delete(found.weights.numpy(), (0, 4), 0)
    np.testing.assert_allclose(others, np.stack(expected, axis=1), atol=1e-5)
    dark = solved(torch.zeros_like(design), target, start)
    assert torch.equal(dark.weights, start) and (dark.status == Status.CONVERGED).all()


def test_no_atoms() -> None:
    empty = torch.zeros(0, 3)
    found = sparse_nnls(
        csr_matrix(torch.zeros(1).long(), torch.zeros(0).long(), torch.zeros(0), (0, 0)),
        torch.zeros(0),
        empty,
        empty,
        steps=3,
        tolerance=1e-4,
    )
    assert found.weights.shape == (0, 3)
    assert (found.status == Status.CONVERGED).all()


def test_equal_atoms_share_what_one_would_have() -> None:
    design, target = problem(5, 1)
    doubled = torch.cat((design, design), dim=1)
    found = solved(doubled, target).weights
    one = solved(design, target).weights
    torch.testing.assert_close(found[:5] + found[5:], one, atol=1e-5, rtol=0)


def test_a_channel_ends_on_its_own() -> None:
    design, target = problem(20, 3)
    whole = solved(design, target).weights
    alone = torch.cat([solved(design, target[:, c : c + 1]).weights for c in range(3)], dim=1)
    torch.testing.assert_close(whole, alone, atol=1e-5, rtol=0)


@pytest.mark.parametrize("value", [torch.nan, torch.inf])
def test_what_is_not_finite_is_told_and_leaves_other_channels_alone(value: float) -> None:
    design, target = problem(20, 3)
    gram, rhs = design.T @ design, design.T @ target
    rhs[3, 1] = value
    start = torch.zeros_like(rhs)
    found = sparse_nnls(sparse(gram), gram.diagonal(), rhs, start, steps=400, tolerance=TOLERANCE)
    kinds = [Status.CONVERGED, Status.NOT_FINITE, Status.CONVERGED]
    assert found.status.tolist() == kinds
    good = solved(design, target).weights
    torch.testing.assert_close(found.weights[:, ::2], good[:, ::2], atol=1e-5, rtol=0)
