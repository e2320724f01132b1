"""Non-negative least squares with one large sparse Gram matrix, by projected conjugate gradients.

Steps are conjugate as long as the same weights are free [Pol69]; where the set changes, or a
step meets the bound and lowers the value less than it should, the next one is steepest descent.

References:
    [Pol69] Boris T. Polyak, The Conjugate Gradient Method in Extremal Problems, USSR Computational
        Mathematics and Mathematical Physics 9(4), 1969.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from ..runtime.device import asks
from ..runtime.sparse import sparse_product
from .status import STATUS_DTYPE, Status

# A step that does not lower the value is tried again with this fraction of its length.
BACKTRACK = 0.25
# Shortest fraction of a step that is tried: below it the weights are as good as they get.
SHORTEST = 1e-4
# Steps after which a GPU is asked whether all problems have converged: the host waits to know it.
CUDA_STEPS = 8


@dataclass(frozen=True)
class SparseNNLSResult:
    """The solution of C problems.

    Attributes:
        weights: `[N, C]`, not negative.
        gradient: G x - b, `[N, C]`.
        status: `[C]` int8.
    """

    weights: Tensor
    gradient: Tensor
    status: Tensor


def sparse_nnls(
    gram: Tensor,
    diagonal: Tensor,
    rhs: Tensor,
    start: Tensor,
    *,
    steps: int,
    tolerance: float,
    ridge: Tensor | None = None,
) -> SparseNNLSResult:
    """Minimizes 1/2 x^T (G + diag(ridge)) x - b^T x over x >= 0 for C right sides b at once.

    Args:
        gram: G, sparse CSR `[N, N]`, symmetric and positive semi-definite.
        diagonal: that of G, `[N]`.
        rhs: b, `[N, C]`.
        start: first x, `[N, C]`, not negative.
        steps: most products with G that steps may take.
        tolerance: largest `violation` of a converged problem.
        ridge: added to the diagonal of G, `[N]`, not negative; None: 0.

    Returns:
        Weights that are never worse than the start.
    """
    if ridge is not None:
        diagonal = diagonal + ridge

    def times(vector: Tensor) -> Tensor:
        product = sparse_product(gram, vector)
        return product if ridge is None else product.addcmul_(ridge[:, None], vector)

    inverse = torch.where(diagonal > 0.0, 1.0 / diagonal, 0.0)[:, None]  # [N, 1]
    downhill, conditions = -inverse, Conditions.of(rhs, inverse)
    x, gradient = start, times(start) - rhs
    value = _value(x, gradient, rhs)  # [C]
    whole = x.new_ones(x.shape[1])
    length = whole
    step, last, free = torch.zeros_like(x), gradient, torch.zeros_like(x).bool()
    squared = torch.zeros_like(length)  # length of the last gradient in the metric 1 / diagonal
    open_ = conditions.violation(x, gradient) > tolerance  # [C]
    for number in range(steps):
        if asks(x, number, CUDA_STEPS) and not bool(open_.any()):
            break
        now = (x > 0.0) | (gradient < 0.0)
        descent = (downhill * gradient).mul_(now)
        same = (now == free).all(0) & (length == 1.0)
        share = _ratio((last - gradient).mul_(descent).sum(0), squared).clamp(min=0.0) * same
        step.mul_(share).add_(descent)
        slope, steepest = (step * gradient).sum(0), (descent * gradient).sum(0)
        falls = slope < 0.0
        step, slope = torch.where(falls, step, descent), torch.where(falls, slope, steepest)
        last, free, squared = gradient, now, -steepest
        along = times(step)
        # Back along the step: the gradient falls towards it.
        reach = _ratio(slope, (step * along).sum(0)) * length * open_
        free_end = x - reach * step
        moved = free_end.clamp(min=0.0)
        bounded = None if x.is_cuda else (free_end < 0.0).any(0)
        if bounded is None:  # the host would wait to know it
            changed = times(moved) - rhs
        else:
            changed = gradient - reach * along
            if bool(bounded.any()):
                changed = torch.where(bounded, times(moved) - rhs, changed)
        found = _value(moved, changed, rhs)
        better = found <= value
        x, gradient = torch.where(better, moved, x), torch.where(better, changed, gradient)
        value = torch.where(better, found, value)
        length = torch.where(better, whole, length * BACKTRACK)
        if not asks(x, number + 1, CUDA_STEPS):
            continue  # steps of converged problems, which nobody asks about, do no harm
        open_ = (conditions.violation(x, gradient) > tolerance) & (length > SHORTEST)
    left = conditions.violation(x, gradient) > tolerance
    status = torch.where(left, Status.LIMIT, Status.CONVERGED).to(STATUS_DTYPE)
    finite = value.isfinite()
    return SparseNNLSResult(x, gradient, status.masked_fill(~finite, Status.NOT_FINITE))


@dataclass(frozen=True)
class Conditions:
    """The optimality conditions of C problems, min(x, G x - b) = 0 with unit atoms.

    Attributes:
        root: of the inverse of the diagonal of G, `[N, 1]`; 0 where that is 0.
        norm: the same; 1 where that is 0, so that no x is wrong there.
        largest: the largest b, `[C]`.
    """

    root: Tensor
    norm: Tensor
    largest: Tensor

    @classmethod
    def of(cls, rhs: Tensor, inverse: Tensor) -> Conditions:
        """Those of right sides `rhs [N, C]`, given the inverse of the diagonal of G, `[N, 1]`."""
        root = inverse.sqrt()
        size = (rhs * root).abs()
        largest = size.amax(0) if len(rhs) else size.sum(0)
        norm = torch.where(root > 0.0, root, 1.0)
        return cls(root, norm, largest.clamp(min=torch.finfo(rhs.dtype).tiny))

    def violation(self, x: Tensor, gradient: Tensor) -> Tensor:
        """Largest violation by `x [N, C]` of gradient G x - b `[N, C]`, `[C]`, relative to b."""
        if not len(x):
            return x.sum(0)
        return torch.minimum(x / self.norm, self.root * gradient).abs().amax(0) / self.largest


def _value(x: Tensor, gradient: Tensor, rhs: Tensor) -> Tensor:
    """Twice 1/2 x^T G x - b^T x, `[C]` float64, given `gradient` G x - b."""
    return (gradient - rhs).double().mul_(x).sum(0)


def _ratio(top: Tensor, bottom: Tensor) -> Tensor:
    """top / bottom `[C]`; 0 where bottom is not positive."""
    return (bottom > 0.0) * (top / bottom.clamp(min=torch.finfo(bottom.dtype).tiny))
