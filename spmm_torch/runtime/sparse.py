"""Sparse matrices, without the notice of torch that they are in beta state."""

from __future__ import annotations

import warnings
from functools import cache

import torch
from torch import Tensor


def csr_matrix(offset: Tensor, column: Tensor, value: Tensor, shape: tuple[int, int]) -> Tensor:
    """A sparse CSR matrix `[M, N]`, whose indices are taken as valid.

    Args:
        offset: first entry of each row, and the number of all, `[M + 1]`.
        column: column of each entry, `[E]`.
        value: value of each entry, `[E]`; entries of the same place add up.
        shape: M and N.
    """
    _take_notice()
    offset, column, value = offset.contiguous(), column.contiguous(), value.contiguous()  # for MKL
    return torch.sparse_csr_tensor(offset, column, value, shape, check_invariants=False)


def sparse_product(matrix: Tensor, dense: Tensor) -> Tensor:
    """The product of a sparse CSR matrix `[M, N]` and a dense one `[N, R]`, without gradients.

    The operator `@` first fills the result with zeros and copies it, which takes longer than the
    product with a matrix of four entries a row.
    """
    result = dense.new_empty(matrix.shape[0], dense.shape[1])
    return torch.addmm(result, matrix, dense, beta=0, out=result)


@cache
def _take_notice() -> None:
    """Makes the first sparse matrix of the process, which alone brings the notice."""
    zero = torch.zeros(1, dtype=torch.int32)
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Sparse CSR tensor support", UserWarning)
        torch.sparse_csr_tensor(
            zero.expand(2), zero[:0], torch.zeros(0), (1, 1), check_invariants=False
        )
