"""The entries of all texels as sparse matrices, for products with what all texels share."""

from __future__ import annotations

import torch
from torch import Tensor

from ...lobes.ragged import stable_order
from ...model.lookup import SparseWeights
from ...runtime.sparse import csr_matrix


def channel_matrices(entries: SparseWeights, lobes: int) -> list[Tensor]:
    """The weights of each channel, sparse CSR `[T, J]`.

    Args:
        entries: fit of all texels.
        lobes: J.
    """
    offset, index = entries.offset.int(), entries.index.int()
    shape = (len(offset) - 1, lobes)
    return [csr_matrix(offset, index, weight, shape) for weight in entries.weight.T]


def joint_matrix(entries: SparseWeights, lobes: int) -> Tensor:
    """The weights of all channels, sparse CSR `[T, J C]`; the channel counts fastest."""
    channels = entries.weight.shape[1]
    channel = torch.arange(channels, device=entries.index.device)
    column = (entries.index[:, None] * channels + channel).flatten().int()
    shape = (len(entries.offset) - 1, lobes * channels)
    return csr_matrix((entries.offset * channels).int(), column, entries.weight.flatten(), shape)


def transposed(matrix: Tensor) -> Tensor:
    """The transpose of a sparse CSR matrix `[M, N]`, sparse CSR `[N, M]`."""
    offset = matrix.crow_indices()
    row = torch.repeat_interleave(offset[1:] - offset[:-1])
    shape = (matrix.shape[1], matrix.shape[0])
    return matrix_of(matrix.col_indices().long(), row, matrix.values(), shape)


def matrix_of(row: Tensor, column: Tensor, value: Tensor, shape: tuple[int, int]) -> Tensor:
    """The sparse CSR matrix `shape` of entries in any order.

    Args:
        row, column, value: of each entry, `[E]`.
        shape: of the matrix.
    """
    order = stable_order(row, shape[0])
    count = torch.bincount(row, minlength=shape[0])
    offset = torch.cat((count.new_zeros(1), count.cumsum(0))).int()
    return csr_matrix(offset, column[order].int(), value[order], shape)


def solve_with_ridge(gram: Tensor, rhs: Tensor, ridge: float) -> Tensor:
    """The solutions `[..., R, N]` of normal equations, in float64.

    Args:
        gram: `[..., R, R]`.
        rhs: `[..., R, N]`.
        ridge: added to the diagonal, relative to its mean.
    """
    mean = gram.diagonal(dim1=-2, dim2=-1).mean(-1)[..., None, None]
    added = ridge * mean.clamp(min=torch.finfo(mean.dtype).tiny)
    matrix = gram + added * torch.eye(gram.shape[-1], dtype=gram.dtype, device=gram.device)
    # The ridge leaves no matrix singular; a check would let the host wait.
    return torch.linalg.solve_ex(matrix.double(), rhs.double()).result.to(rhs)


def side_by_side(parts: Tensor) -> Tensor:
    """Matrices `[n, A, B]` side by side, `[A, n B]`, so that one product serves all."""
    return parts.transpose(0, 1).flatten(1)


def by_channel(rho: Tensor, channels: int) -> Tensor:
    """Lobes `[n, J, L]`, each for every channel alone, `[n L C, J C]`."""
    views, lobes, lights = rho.shape
    table = rho.new_zeros(views, lights, channels, lobes, channels)
    table.diagonal(dim1=2, dim2=4).copy_(rho.transpose(1, 2)[..., None])  # [n, L, J, C]
    return table.flatten(3).flatten(0, 2)


def rows_by_view(columns: Tensor, run: slice) -> Tensor:
    """Columns `[T, n B]` of the n views of a run as rows `[n T, B]`, view by view."""
    return columns.unflatten(1, (run.stop - run.start, -1)).transpose(0, 1).flatten(0, 1)


def columns_by_view(rows: Tensor, run: slice) -> Tensor:
    """Rows `[n T, B]` of the n views of a run, view by view, as columns `[T, n B]`."""
    return side_by_side(rows.unflatten(0, (run.stop - run.start, -1)))


def products_at(pattern: Tensor, left: Tensor, right: Tensor) -> Tensor:
    """The entries `[N]` of the product of `left [T, L]` and `right [L, J]` where a pattern has any.

    Args:
        pattern: sparse CSR `[T, J]`; its values are not read.
        left, right: factors.
    """
    zeros = torch.zeros_like(pattern.values())
    bare = csr_matrix(
        pattern.crow_indices(), pattern.col_indices(), zeros, (pattern.shape[0], pattern.shape[1])
    )
    return torch.sparse.sampled_addmm(bare, left, right).values()
