"""Non-negative least squares of problems scaled to unit atoms: pivoting, then the active set.

Block principal pivoting [PJV94] with the exchange rule of [KP11] solves nearly every problem in a
few rounds, the active set of [LH74] solves the rest.

References:
    [LH74] Charles L. Lawson, Richard J. Hanson, Solving Least Squares Problems, Prentice-Hall,
        1974, ch. 23.
    [PJV94] Luis F. Portugal, Joaquim J. Judice, Luis N. Vicente, A Comparison of Block Pivoting and
        Interior-Point Algorithms for Linear Least Squares Problems with Nonnegative Variables,
        Mathematics of Computation 63(208), 1994.
    [KP11] Jingu Kim, Haesun Park, Fast Nonnegative Matrix Factorization: An Active-Set-Like Method
        and Comparisons, SIAM Journal on Scientific Computing 33(6), 2011, §3.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from .status import STATUS_DTYPE, Status

# Ridge on the unit diagonal: makes duplicated atoms solvable, biases a well-posed x by 1e-12.
RIDGE = 1e-12
# Factor of the ridge after a failed factorization: a float32 Gram can be indefinite by 1e-7.
RIDGE_GROWTH = 10.0
RIDGE_LIMIT = 1e-2
# Optimality slack, relative to the largest |b_j| / |d_j|; well above float64 rounding of G x.
OPTIMALITY_TOLERANCE = 1e-11
# Full exchanges without progress before the active set takes over [KP11 §3, alpha].
PIVOT_PATIENCE = 3
PIVOT_ROUNDS = 12
# Exchanges on a GPU after each of which solved problems are left out: the host waits to know them.
CUDA_ROUNDS = 3


@dataclass(frozen=True)
class UnitProblems:
    """Problems scaled to unit atoms and unit right-hand side, float64."""

    gram: Tensor  # [B, J, J], unit diagonal
    rhs: Tensor  # [B, J], largest magnitude 1
    allowed: Tensor  # [B, J] bool

    def take(self, rows: Tensor) -> UnitProblems:
        """The problems `rows [b]`."""
        return UnitProblems(self.gram[rows], self.rhs[rows], self.allowed[rows])


def solve_unit(problems: UnitProblems, passive: Tensor, passes: int) -> tuple[Tensor, Tensor]:
    """Weights `[B, J]` and status `[B]` by pivoting, then by the active set for what is left.

    Args:
        problems: B problems.
        passive: likely support, `[B, J]` bool.
        passes: most passes of the active set.
    """
    pivot = _pivot_together if passive.is_cuda else _pivot
    weights, open_rows = pivot(problems, passive)
    status = torch.full_like(passive[:, 0], Status.CONVERGED, dtype=STATUS_DTYPE)
    if open_rows.numel():
        unsolved = problems.take(open_rows)
        weights[open_rows], ended = _active_set(unsolved, weights[open_rows], passes)
        finite = unsolved.gram.isfinite().all(-1).all(-1)
        status[open_rows] = ended.masked_fill(~finite, Status.NOT_FINITE)
    return weights, status


def _solve_support(
    problems: UnitProblems, passive: Tensor, ridge: float | Tensor
) -> tuple[Tensor, Tensor]:
    """Unconstrained minimizer on the passive set `[B, J]`, and where the factorization failed.

    Inactive variables become rows and columns of a diagonal, so that all problems keep size J.
    """
    member = passive.to(problems.gram.dtype)  # [B, J]
    matrix = problems.gram * member[:, :, None] * member[:, None, :]  # [B, J, J]
    diagonal = matrix.diagonal(dim1=-2, dim2=-1)
    if isinstance(ridge, Tensor):
        diagonal.copy_(1.0 + ridge)
    else:
        diagonal.fill_(1.0 + ridge)
    factor, info = torch.linalg.cholesky_ex(matrix)
    point = torch.cholesky_solve((problems.rhs * member)[..., None], factor)[..., 0]  # [B, J]
    return point, info != 0


def _dual(problems: UnitProblems, weights: Tensor) -> Tensor:
    """w = b - G x, `[B, J]`: correlation of each unit atom with the residual."""
    return problems.rhs - (problems.gram @ weights[..., None])[..., 0]


def _pivot(problems: UnitProblems, passive: Tensor) -> tuple[Tensor, Tensor]:
    """Block principal pivoting with full exchanges [KP11 §3]: weights `[B, J]`.

    A problem whose number of infeasible variables has not fallen for `PIVOT_PATIENCE` exchanges is
    left unsolved. Its weights are then a feasible start for `_active_set`.

    Returns:
        (weights, indices of the unsolved problems).
    """
    batch, atoms = problems.rhs.shape
    weights = torch.zeros_like(problems.rhs)
    solved = torch.zeros(batch, dtype=torch.bool, device=weights.device)
    rows = torch.arange(batch, device=weights.device)
    fewest = torch.full((batch,), atoms + 1, device=weights.device)
    patience = torch.full((batch,), PIVOT_PATIENCE, device=weights.device)
    for _ in range(PIVOT_ROUNDS):
        point, failed, swap = _exchange(problems, passive)
        count = swap.sum(-1)
        weights[rows] = torch.where(failed[:, None], weights[rows], point.clamp_min(0))
        solved[rows] = (count == 0) & ~failed
        patience = torch.where(count < fewest, PIVOT_PATIENCE, patience - 1)
        fewest = torch.minimum(fewest, count)
        keep = ((count > 0) & ~failed & (patience > 0)).nonzero()[:, 0]
        problems, rows, passive = problems.take(keep), rows[keep], (passive ^ swap)[keep]
        fewest, patience = fewest[keep], patience[keep]
        if not keep.numel():
            break
    return weights, (~solved).nonzero()[:, 0]


def _pivot_together(problems: UnitProblems, passive: Tensor) -> tuple[Tensor, Tensor]:
    """`_pivot` on a GPU, which is asked for little and rarely: solved problems stay for a while.

    A problem that is open after all rounds is left unsolved.
    """
    weights = torch.zeros_like(problems.rhs)
    rows = torch.arange(len(weights), device=weights.device)
    for number in range(1, 1 + PIVOT_ROUNDS):
        point, failed, swap = _exchange(problems, passive)
        passive = passive ^ swap  # stays as it is where a problem is solved
        if number % CUDA_ROUNDS:
            continue
        weights[rows] = torch.where(failed[:, None], weights[rows], point.clamp_min(0))
        keep = (swap.any(-1) | failed).nonzero()[:, 0]
        rows = rows[keep]
        if not keep.numel():
            break
        problems, passive = problems.take(keep), passive[keep]
    return weights, rows


def _exchange(problems: UnitProblems, passive: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Minimizer on the passive set `[B, J]`, where it failed `[B]`, what is infeasible `[B, J]`."""
    point, failed = _solve_support(problems, passive, RIDGE)
    entering = problems.allowed & (_dual(problems, point) > OPTIMALITY_TOLERANCE)
    return point, failed, torch.where(passive, point < -OPTIMALITY_TOLERANCE, entering)


def _active_set(problems: UnitProblems, start: Tensor, passes: int) -> tuple[Tensor, Tensor]:
    """Lawson-Hanson from a feasible start, all problems together: weights `[B, J]`, status `[B]`.

    One pass solves on the passive set. It then either accepts the point, and the atom of largest
    dual enters, or moves to the boundary, and the atoms that reach 0 leave.
    """
    weights = start.clone()
    result = start.clone()
    rows = torch.arange(start.shape[0], device=start.device)
    status = torch.full_like(rows, Status.CONVERGED, dtype=STATUS_DTYPE)
    passive = start > 0  # [B, J]
    barred = torch.zeros_like(passive)
    newest = torch.full_like(rows, -1)
    ridge = torch.full_like(start[:, :1], RIDGE)  # [B, 1]
    for _ in range(passes):
        point, failed = _solve_support(problems, passive, ridge)
        ridge = torch.where(failed[:, None], ridge * RIDGE_GROWTH, ridge)
        inside = (point >= 0).all(-1) & ~failed  # [B']
        weights, boundary = _toward(weights, point, passive, inside, failed)
        # An atom that leaves at once entered by rounding: bar it until another one stays [LH74].
        entered = torch.zeros_like(passive).scatter_(1, newest.clamp_min(0)[:, None], True)
        entered &= (newest >= 0)[:, None]
        survived = inside & (newest >= 0)
        barred = (barred & ~survived[:, None]) | (entered & boundary)
        passive = passive & ~boundary
        dual = _dual(problems, weights)
        dual = torch.where(problems.allowed & ~passive & ~barred, dual, -torch.inf)
        largest, newest_atom = dual.max(-1)
        improving = inside & (largest > OPTIMALITY_TOLERANCE)
        passive = passive.scatter(
            1, newest_atom[:, None], passive.gather(1, newest_atom[:, None]) | improving[:, None]
        )
        newest = torch.where(improving, newest_atom, torch.where(failed, newest, -1))
        result[rows] = weights
        solvable = ridge[:, 0] < RIDGE_LIMIT
        keep = (~(inside & ~improving) & solvable).nonzero()[:, 0]
        if keep.numel() < rows.numel():
            # Final for the rows that leave here; the others are overwritten later.
            status[rows] = torch.where(solvable, Status.CONVERGED, Status.NO_DESCENT).to(status)
            problems, rows, weights = problems.take(keep), rows[keep], weights[keep]
            passive, barred, newest, ridge = (v[keep] for v in (passive, barred, newest, ridge))
        if not keep.numel():
            break
    status[rows] = Status.LIMIT
    return result, status


def _toward(
    weights: Tensor, point: Tensor, passive: Tensor, inside: Tensor, failed: Tensor
) -> tuple[Tensor, Tensor]:
    """(x `[B, J]` moved to `point` as far as x >= 0 allows, atoms `[B, J]` that reach 0)."""
    falling = passive & (point < 0)  # [B, J]
    ratio = torch.where(falling, weights / (weights - point), torch.inf)
    length = ratio.amin(-1, keepdim=True).clamp_max(1)  # [B, 1]
    length = torch.where(failed[:, None], 0.0, torch.where(inside[:, None], 1.0, length))
    moved = torch.where(failed[:, None], weights, weights + length * (point - weights))
    boundary = falling & (ratio <= length) & ~failed[:, None]
    moved = torch.where(inside[:, None], point, torch.where(boundary, 0.0, moved))
    return moved.clamp_min(0), boundary
