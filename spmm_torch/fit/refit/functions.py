"""The functions of a residual of rank R: the leading singular functions of what the lobes leave.

References:
    [HMT11] Nathan Halko, Per-Gunnar Martinsson, Joel A. Tropp, Finding Structure with Randomness:
        Probabilistic Algorithms for Constructing Approximate Matrix Decompositions, SIAM Review
        53(2), 2011.
"""

from __future__ import annotations

import torch
from torch import Tensor

from ...lobes.batch import LobeBatch
from ...model.lookup import SparseWeights
from ..problem import Problem
from .cluster_functions import lobe_values

# Bytes of the aligned values that the functions are found on: some thousand texels, which span
# the same leading functions as all of them.
SAMPLE_BYTES = 1 << 28
# Columns of the random matrix beyond R, and power iterations [HMT11, Alg. 4.4].
OVERSAMPLING, ITERATIONS = 8, 2


def residual_functions(problem: Problem, lobes: LobeBatch, entries: SparseWeights) -> Tensor:
    """Orthonormal functions `[D, R, C]` with the weights of pairs, fewer where texels are few.

    Args:
        problem: of the fit.
        lobes: J lobes.
        entries: fit of all texels to the aligned values.
    """
    btf, generator = problem.btf, problem.context.generator("functions")
    width = btf.pair_count * btf.channels
    count = max(1, SAMPLE_BYTES // (4 * width))
    texels = torch.randperm(btf.texel_count, generator=generator)[:count].sort().values
    rows = left_over(problem, lobes, entries, texels)  # [n, C D]
    rank = min(problem.config.residual.rank, *rows.shape)
    probe = torch.randn(len(rows), min(rank + OVERSAMPLING, *rows.shape), generator=generator)
    basis = torch.linalg.qr(rows.T @ probe.to(rows)).Q
    for _ in range(ITERATIONS):
        basis = torch.linalg.qr(rows.T @ (rows @ basis)).Q
    turn = torch.linalg.svd((rows @ basis).double(), full_matrices=False).Vh[:rank].T
    functions = basis @ turn.to(basis)  # [C D, R]
    return functions.view(btf.channels, btf.pair_count, rank).permute(1, 2, 0).contiguous()


def left_over(problem: Problem, lobes: LobeBatch, entries: SparseWeights, texels: Tensor) -> Tensor:
    """What the lobes leave of the aligned values of `texels [n]`, by weight: `[n, C D]`."""
    own = entries.of(texels.to(entries.index.device))
    rho = problem.grid().eval(lobes)  # [J, D]
    left = problem.signals(texels) - lobe_values(own, rho).transpose(1, 2)  # [n, C, D]
    importance = problem.importance(texels)
    if importance is not None:
        left = left * importance.to(left).sqrt()[:, None, None]
    return left.flatten(1)
