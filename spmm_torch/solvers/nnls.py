"""Batched non-negative least squares in Gram form.

Solves argmin_{x >= 0} 1/2 x^T G x - b^T x, with G = D^T D and b = D^T y, for many small problems
at once. Both stages are exact: block principal pivoting [PJV94] with the exchange rule of [KP11]
solves nearly every problem in a few rounds, the active set of [LH74] solves the rest.

The dual is w = b - G x, minus the gradient, as in [LH74]. A minimizer has w <= 0, and w = 0 where
x > 0.

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

from .nnls_supports import MOST_ATOMS, nnls_by_supports
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
# float64 values in one block of Gram matrices (32 MiB): bounds the memory for any batch.
BLOCK_ELEMENTS = 2**22
# The same on a GPU (512 MiB), which is to solve 65,536 texels of three channels at once.
CUDA_ELEMENTS = 2**26


@dataclass(frozen=True)
class NNLSResult:
    """Minimizers of a batch of problems.

    Attributes:
        weights: x `[..., J]`, non-negative.
        status: `[...]` int8. LIMIT: passes of the active set ran out, x is feasible but not
            optimal. NO_DESCENT: a Gram so far from positive semidefinite that its system has no
            solution, x is the last feasible point. NOT_FINITE: of the Gram, b or x.
    """

    weights: Tensor
    status: Tensor


@dataclass(frozen=True)
class _Problems:
    """Problems scaled to unit atoms and unit right-hand side, float64."""

    gram: Tensor  # [B, J, J], unit diagonal
    rhs: Tensor  # [B, J], largest magnitude 1
    allowed: Tensor  # [B, J] bool

    def take(self, rows: Tensor) -> _Problems:
        return _Problems(self.gram[rows], self.rhs[rows], self.allowed[rows])


def nnls_gram(
    gram: Tensor,
    rhs: Tensor,
    *,
    allowed: Tensor | None = None,
    guess: Tensor | None = None,
    max_iterations: int | None = None,
    block: int = BLOCK_ELEMENTS,
) -> NNLSResult:
    """Minimizes 1/2 x^T G x - b^T x over x >= 0, each problem on its own [LH74].

    Duplicated and zero atoms are fine: the result is one of the minimizers, zero for zero atoms.

    Args:
        gram: D^T D, `[..., J, J]`; its batch dimensions broadcast against those of `rhs`.
        rhs: D^T y, `[..., J]`.
        allowed: bool `[..., J]`, broadcast; False holds a weight at zero. Default: all allowed.
        guess: bool `[..., J]`, broadcast; likely support of the solution, for speed only.
        max_iterations: most passes of the active set, default 3 J + 30.
        block: elements of the Gram matrices of one block.

    Returns:
        Weights `[..., J]` in the dtype of `rhs`, and status `[...]`.
    """
    atoms = rhs.shape[-1]
    batch = torch.broadcast_shapes(gram.shape[:-2], rhs.shape[:-1])
    flat_rhs = rhs.expand(*batch, atoms).reshape(-1, atoms)  # [B, J]
    flat_gram, gram_row = _flatten_gram(gram, batch)
    flat_allowed = _flatten_mask(allowed, batch, atoms)
    flat_guess = _flatten_mask(guess, batch, atoms)
    passes = 3 * atoms + 30 if max_iterations is None else max_iterations
    weights = torch.zeros_like(flat_rhs)
    status = torch.full_like(flat_rhs.sum(1), Status.CONVERGED, dtype=STATUS_DTYPE)
    size = max(1, block // max(1, atoms * atoms))
    for first in range(0, flat_rhs.shape[0] if atoms else 0, size):
        rows = slice(first, first + size)
        solved, status[rows] = _solve_block(
            flat_gram[gram_row[rows]].double(),
            flat_rhs[rows].double(),
            None if flat_allowed is None else flat_allowed[rows],
            None if flat_guess is None else flat_guess[rows],
            passes,
        )
        weights[rows] = solved.to(rhs.dtype)
    return NNLSResult(weights.reshape(*batch, atoms), status.reshape(batch))


def nnls_shared_gram(
    gram: Tensor, rhs: Tensor, *, allowed: Tensor, guess: Tensor | None = None
) -> NNLSResult:
    """`nnls_gram` of problems whose C channels share a Gram, fast where few weights are zero.

    One factorization serves all channels of a problem. Channels in which its unconstrained
    minimizer is not feasible are solved one by one.

    Args:
        gram: D^T D, `[B, J, J]`.
        rhs: D^T y, `[B, C, J]` float64.
        allowed: `[B, J]` bool; False holds a weight at zero in all channels.
        guess: `[B, C, J]` bool; likely support of the solution, for speed only. Default: all
            allowed.

    Returns:
        Weights `[B, C, J]` float64, and status `[B, C]`.
    """
    gram = gram.double()
    if gram.is_cuda and 0 < gram.shape[-1] <= MOST_ATOMS:
        return NNLSResult(*nnls_by_supports(gram, rhs, allowed))
    if gram.is_cuda:  # all channels alike: the host waits less
        each = allowed[:, None]
        likely = each if guess is None else guess
        return nnls_gram(gram[:, None], rhs, allowed=each, guess=likely, block=CUDA_ELEMENTS)
    norm = gram.diagonal(dim1=-2, dim2=-1)  # [B, J]
    usable = allowed & (norm > 0)
    matrix = torch.where(usable[:, :, None] & usable[:, None, :], gram, 0.0)
    diagonal = torch.where(usable, norm * (1 + RIDGE), 1.0)
    matrix.diagonal(dim1=-2, dim2=-1).copy_(diagonal)
    factor, info = torch.linalg.cholesky_ex(matrix)
    target = torch.where(usable[:, None], rhs, 0.0).transpose(1, 2)  # [B, J, C]
    weights = torch.cholesky_solve(target, factor).transpose(1, 2)  # [B, C, J]
    least = weights.amin(-1) if weights.shape[-1] else weights.new_zeros(weights.shape[:2])
    status = torch.full_like(least, Status.CONVERGED, dtype=STATUS_DTYPE)  # [B, C]
    finite = (weights.sum(-1) + norm.sum(-1, keepdim=True)).isfinite()
    status.masked_fill_(~finite, Status.NOT_FINITE)
    rows, channels = ((least < 0) | (info != 0)[:, None]).nonzero(as_tuple=True)
    if len(rows):
        likely = weights[rows, channels] > 0
        likely = likely if guess is None else likely & guess[rows, channels]
        single = nnls_gram(gram[rows], rhs[rows, channels], allowed=allowed[rows], guess=likely)
        weights[rows, channels], status[rows, channels] = single.weights, single.status
    return NNLSResult(weights, status)


def kkt_violation(gram: Tensor, rhs: Tensor, x: Tensor, *, allowed: Tensor | None = None) -> Tensor:
    """Largest violation of the optimality conditions of `nnls_gram`, zero at a minimizer.

    With unit atoms and the dual w = b - G x the conditions are min(x, -w) = 0 elementwise; the
    value is the largest |min(x, -w)|, relative to the largest |b_j|.

    Args:
        gram: `[..., J, J]`.
        rhs: `[..., J]`.
        x: candidate solution `[..., J]`.
        allowed: bool `[..., J]`; weights held at zero are not judged.

    Returns:
        Violation `[...]`, float64.
    """
    gram, rhs, x = gram.double(), rhs.double(), x.double()
    norm = gram.diagonal(dim1=-2, dim2=-1).clamp_min(0).sqrt()  # [..., J]
    inverse = torch.where(norm > 0, 1 / norm, 0.0)
    dual = (rhs - (gram @ x[..., None])[..., 0]) * inverse  # [..., J]
    violation = torch.minimum(x * norm, -dual).abs()
    if allowed is not None:
        violation = torch.where(allowed, violation, 0.0)
    scale = (rhs * inverse).abs().amax(-1)
    return violation.amax(-1) / torch.where(scale > 0, scale, 1.0)


def _flatten_gram(gram: Tensor, batch: torch.Size) -> tuple[Tensor, Tensor]:
    """Stored Grams `[G, J, J]` and the Gram row of each problem `[B]`; no broadcast copy."""
    stored = gram.reshape(-1, *gram.shape[-2:])  # [G, J, J]
    row = torch.arange(stored.shape[0], device=gram.device).reshape(gram.shape[:-2])
    return stored, row.expand(batch).reshape(-1)


def _flatten_mask(mask: Tensor | None, batch: torch.Size, atoms: int) -> Tensor | None:
    return None if mask is None else mask.expand(*batch, atoms).reshape(-1, atoms)


def _solve_block(
    gram: Tensor, rhs: Tensor, allowed: Tensor | None, guess: Tensor | None, passes: int
) -> tuple[Tensor, Tensor]:
    """Scales one block of problems, solves it, scales the weights `[B, J]` back; status `[B]`."""
    norm = gram.diagonal(dim1=-2, dim2=-1).clamp_min(0).sqrt()  # [B, J]
    usable = norm > 0 if allowed is None else allowed & (norm > 0)
    inverse = torch.where(norm > 0, 1 / norm, 0.0)  # [B, J]
    unit_rhs = rhs * inverse
    scale = torch.where(usable, unit_rhs, 0.0).abs().amax(-1, keepdim=True)  # [B, 1]
    scale = torch.where(scale > 0, scale, 1.0)
    problems = _Problems(gram * inverse[:, :, None] * inverse[:, None, :], unit_rhs / scale, usable)
    passive = usable & (problems.rhs > 0) if guess is None else usable & guess  # [B, J]
    weights, status = _solve_unit(problems, passive, passes)
    weights = weights * inverse * scale
    finite = (weights + norm).sum(-1).isfinite()
    return weights, status.masked_fill(~finite, Status.NOT_FINITE)


def _solve_unit(problems: _Problems, passive: Tensor, passes: int) -> tuple[Tensor, Tensor]:
    """Pivots, then runs the active set on what is left; weights `[B, J]` and status `[B]`."""
    weights, open_rows = _pivot(problems, passive)
    status = torch.full_like(passive[:, 0], Status.CONVERGED, dtype=STATUS_DTYPE)
    if open_rows.numel():
        unsolved = problems.take(open_rows)
        weights[open_rows], ended = _active_set(unsolved, weights[open_rows], passes)
        finite = unsolved.gram.isfinite().all(-1).all(-1)
        status[open_rows] = ended.masked_fill(~finite, Status.NOT_FINITE)
    return weights, status


def _solve_support(
    problems: _Problems, passive: Tensor, ridge: float | Tensor
) -> tuple[Tensor, Tensor]:
    """Unconstrained minimizer on the passive set `[B, J]`, and where the factorization failed.

    Inactive variables become rows and columns of the identity, so that all problems keep size J.
    """
    member = passive.to(problems.gram.dtype)  # [B, J]
    matrix = problems.gram * member[:, :, None] * member[:, None, :]  # [B, J, J]
    matrix.diagonal(dim1=-2, dim2=-1).copy_(1 + ridge * member)
    factor, info = torch.linalg.cholesky_ex(matrix)
    point = torch.cholesky_solve((problems.rhs * member)[..., None], factor)[..., 0]  # [B, J]
    return point * member, info != 0


def _dual(problems: _Problems, weights: Tensor) -> Tensor:
    """w = b - G x, `[B, J]`: correlation of each unit atom with the residual."""
    return problems.rhs - (problems.gram @ weights[..., None])[..., 0]


def _pivot(problems: _Problems, passive: Tensor) -> tuple[Tensor, Tensor]:
    """Block principal pivoting with full exchanges [KP11 §3]: weights `[B, J]`.

    A problem whose number of infeasible variables has not fallen for `PIVOT_PATIENCE` exchanges is
    left unsolved, on a GPU one that is open after all rounds. Its weights are then a feasible start
    for `_active_set`.

    Returns:
        (weights, indices of the unsolved problems).
    """
    batch, atoms = problems.rhs.shape
    weights = torch.zeros_like(problems.rhs)
    solved = torch.zeros(batch, dtype=torch.bool, device=weights.device)
    rows = torch.arange(batch, device=weights.device)
    fewest = torch.full((batch,), atoms + 1, device=weights.device)
    patience = torch.full((batch,), PIVOT_PATIENCE, device=weights.device)
    for number in range(1, 1 + PIVOT_ROUNDS):
        point, failed = _solve_support(problems, passive, RIDGE)
        dual = _dual(problems, point)
        entering = problems.allowed & (dual > OPTIMALITY_TOLERANCE)  # [B', J]
        swap = torch.where(passive, point < -OPTIMALITY_TOLERANCE, entering)
        if rows.is_cuda and number % CUDA_ROUNDS:
            passive = passive ^ swap  # stays as it is where a problem is solved
            continue
        count = swap.sum(-1)
        weights[rows] = torch.where(failed[:, None], weights[rows], point.clamp_min(0))
        solved[rows] = (count == 0) & ~failed
        better = count < fewest
        patience = torch.where(better, PIVOT_PATIENCE, patience - 1)
        fewest = torch.minimum(fewest, count)
        passive = passive ^ swap
        still = (count > 0) | failed if rows.is_cuda else (count > 0) & ~failed & (patience > 0)
        keep = still.nonzero()[:, 0]
        problems, rows = problems.take(keep), rows[keep]
        passive, fewest, patience = passive[keep], fewest[keep], patience[keep]
        if not keep.numel():
            break
    return weights, rows if rows.is_cuda else (~solved).nonzero()[:, 0]


def _active_set(problems: _Problems, start: Tensor, passes: int) -> tuple[Tensor, Tensor]:
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
