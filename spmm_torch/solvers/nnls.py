"""Batched non-negative least squares in Gram form.

Solves argmin_{x >= 0} 1/2 x^T G x - b^T x, with G = D^T D and b = D^T y, for many small problems
at once: few atoms by all their supports, others as problems of unit atoms; both are exact.

The dual is w = b - G x, minus the gradient, as in [LH74]. A minimizer has w <= 0, and w = 0 where
x > 0.

References:
    [LH74] Charles L. Lawson, Richard J. Hanson, Solving Least Squares Problems, Prentice-Hall,
        1974, ch. 23.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from ..geometry.shapes import broadcast_shape
from ..runtime.memory import slices
from .nnls_supports import MOST_ATOMS, nnls_by_supports
from .nnls_unit import RIDGE, UnitProblems, solve_unit
from .status import STATUS_DTYPE, Status

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
    batch = broadcast_shape(gram.shape[:-2], rhs.shape[:-1])
    flat_rhs = rhs.expand(*batch, atoms).reshape(-1, atoms)  # [B, J]
    flat_gram, gram_row = _flatten_gram(gram, batch)
    flat_allowed = _flatten_mask(allowed, batch, atoms)
    flat_guess = _flatten_mask(guess, batch, atoms)
    passes = 3 * atoms + 30 if max_iterations is None else max_iterations
    if not flat_rhs.numel():
        return NNLSResult(rhs.new_zeros(*batch, atoms), rhs.new_zeros(batch, dtype=STATUS_DTYPE))
    parts = [
        _solve_block(
            flat_gram[gram_row[rows]].double(),
            flat_rhs[rows].double(),
            None if flat_allowed is None else flat_allowed[rows],
            None if flat_guess is None else flat_guess[rows],
            passes,
        )
        for rows in slices(len(flat_rhs), max(1, block // (atoms * atoms)))
    ]
    weights, status = (torch.cat(column) for column in zip(*parts, strict=True))
    return NNLSResult(weights.to(rhs.dtype).reshape(*batch, atoms), status.reshape(batch))


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
    positive = norm > 0
    usable = positive if allowed is None else allowed & positive
    inverse = torch.where(positive, 1 / norm, 0.0)  # [B, J]
    unit_rhs = rhs * inverse
    scale = torch.where(usable, unit_rhs, 0.0).abs().amax(-1, keepdim=True)  # [B, 1]
    scale = torch.where(scale > 0, scale, 1.0)
    problems = UnitProblems(
        gram * inverse[:, :, None] * inverse[:, None, :], unit_rhs / scale, usable
    )
    passive = usable & (problems.rhs > 0) if guess is None else usable & guess  # [B, J]
    weights, status = solve_unit(problems, passive, passes)
    weights = weights * inverse * scale
    total = (weights + norm).sum(-1)
    return weights, status.masked_fill((total - total) != 0.0, Status.NOT_FINITE)
