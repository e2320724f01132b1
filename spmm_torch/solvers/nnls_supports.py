"""Non-negative least squares of few atoms by all supports at once: no loop, no wait for a GPU."""

from __future__ import annotations

import torch
from torch import Tensor

from .status import STATUS_DTYPE, Status

# Most atoms: 16 supports. More would cost more work than the rounds of an active set.
MOST_ATOMS = 4
# Ridge on the unit diagonal: makes duplicated atoms solvable, biases a well-posed x by 1e-12.
RIDGE = 1e-12


def nnls_by_supports(gram: Tensor, rhs: Tensor, allowed: Tensor) -> tuple[Tensor, Tensor]:
    """Minimizes 1/2 x^T G x - b^T x over x >= 0 for the C channels of B problems.

    The minimizer is that of its own support without bounds, so the best of all supports whose
    minimizers are feasible is exact.

    Args:
        gram: `[B, J, J]` float64, J of at most `MOST_ATOMS`.
        rhs: `[B, C, J]` float64.
        allowed: `[B, J]` bool; False holds a weight at zero.

    Returns:
        Weights `[B, C, J]`, and status `[B, C]` int8: CONVERGED or NOT_FINITE.
    """
    atoms = torch.arange(gram.shape[-1], device=gram.device)
    codes = torch.arange(1 << len(atoms), device=gram.device)
    norm = gram.diagonal(dim1=-2, dim2=-1)  # [B, J]
    usable = allowed & (norm > 0)
    member = ((codes[:, None] >> atoms) & 1).double() * usable[:, None]  # [B, N, J]
    inverse = torch.where(usable, norm.clamp(min=torch.finfo(norm.dtype).tiny).rsqrt(), 0.0)
    unit = gram * inverse[:, :, None] * inverse[:, None, :]
    matrix = unit[:, None] * member[..., None] * member[:, :, None]  # [B, N, J, J]
    matrix.diagonal(dim1=-2, dim2=-1).copy_(1.0 + RIDGE * member)
    factor, info = torch.linalg.cholesky_ex(matrix)
    target = (rhs * inverse[:, None])[:, None] * member[:, :, None]  # [B, N, C, J]
    point = torch.cholesky_solve(target.transpose(2, 3), factor).transpose(2, 3)
    gain = (target * point).sum(-1)  # [B, N, C]
    gain = gain.masked_fill((point < 0).any(-1) | (info != 0)[..., None], -1.0)
    best = gain.argmax(1, keepdim=True)[..., None].expand(-1, -1, -1, len(atoms))
    weights = point.gather(1, best).squeeze(1) * inverse[:, None]
    finite = (rhs.sum(-1) + norm.sum(-1, keepdim=True)).isfinite()  # [B, C]
    status = torch.where(finite, int(Status.CONVERGED), int(Status.NOT_FINITE)).to(STATUS_DTYPE)
    return weights, status
