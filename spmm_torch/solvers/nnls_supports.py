"""Non-negative least squares of few atoms by all supports at once: no loop, no wait for a GPU."""

from __future__ import annotations

from functools import cache

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
    atoms, norm = gram.shape[-1], gram.diagonal(dim1=-2, dim2=-1)  # [B, J]
    usable = allowed & (norm > 0)
    member = _supports(type(gram), atoms, gram.device) * usable[:, None]  # [B, N, J]
    inverse = norm.clamp(min=torch.finfo(norm.dtype).tiny).rsqrt() * usable
    unit = gram * inverse[:, :, None] * inverse[:, None, :]
    matrix = unit[:, None] * member[..., None] * member[:, :, None]  # [B, N, J, J]
    matrix.diagonal(dim1=-2, dim2=-1).fill_(1.0 + RIDGE)
    factor, info = torch.linalg.cholesky_ex(matrix)
    target = (rhs * inverse[:, None])[:, None] * member[:, :, None]  # [B, N, C, J]
    point = torch.cholesky_solve(target.transpose(2, 3), factor).transpose(2, 3)
    gain = (target * point).sum(-1)  # [B, N, C]
    gain = gain.masked_fill((point < 0).any(-1) | (info != 0)[..., None], -1.0)
    best = gain.argmax(1, keepdim=True)[..., None].expand(-1, -1, -1, atoms)
    weights = point.gather(1, best).squeeze(1) * inverse[:, None]
    total = rhs.sum(-1) + norm.sum(-1, keepdim=True)  # [B, C]
    status = torch.full_like(total, int(Status.CONVERGED), dtype=STATUS_DTYPE)
    return weights, status.masked_fill_((total - total) != 0.0, int(Status.NOT_FINITE))


@cache
def _supports(kind: type[Tensor], atoms: int, device: torch.device) -> Tensor:
    """Members of every support of so many atoms, `[N, J]` float64.

    A simulated device has tensors of a `kind` of their own.
    """
    codes = torch.arange(1 << atoms, device=device)[:, None]
    return ((codes >> torch.arange(atoms, device=device)) & 1).double()
