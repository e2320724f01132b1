"""Sparse matrices, their products, and the notice that they must not bring."""

from __future__ import annotations

import subprocess
import sys

import pytest
import torch

from spmm_torch.runtime.sparse import csr_matrix, sparse_product

PROGRAM = """
import torch
from spmm_torch.runtime.sparse import csr_matrix
csr_matrix(torch.tensor((0, 1)), torch.tensor((0,)), torch.ones(1), (1, 1)) @ torch.ones(1, 1)
"""


def test_entries_of_one_place_add_up() -> None:
    offset, column = torch.tensor((0, 3, 3)), torch.tensor((2, 0, 2))
    matrix = csr_matrix(offset, column, torch.tensor((1.0, 2.0, 4.0)), (2, 3))
    dense = torch.tensor(((2.0, 0.0, 5.0), (0.0, 0.0, 0.0)))
    assert torch.equal(matrix @ torch.eye(3), dense)


def test_the_first_one_of_a_process_is_silent() -> None:
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", PROGRAM], capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stderr) == (0, "")


def test_entries_of_any_stride() -> None:
    """Entries that share memory, as those of one texel may, are read as they look."""
    column = torch.zeros(1, dtype=torch.int32).expand(4)
    value = torch.tensor([2.0]).expand(4)
    matrix = csr_matrix(torch.tensor([0, 4], dtype=torch.int32), column, value, (1, 1))
    assert float(matrix @ torch.ones(1, 3).sum(1, keepdim=True)) == 24.0


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
@pytest.mark.parametrize("share", [0.0, 0.3])
@pytest.mark.parametrize("columns", [0, 1, 5])
def test_product_over_whatever_memory_held(
    columns: int, share: float, dtype: torch.dtype, monkeypatch: pytest.MonkeyPatch
) -> None:
    generator = torch.Generator().manual_seed(0)
    rows = torch.rand(7, 4, generator=generator, dtype=dtype)
    held = rows * (torch.rand(7, 4, generator=generator) < share)
    offset = torch.cat((torch.zeros(1), (held != 0).sum(1).cumsum(0))).int()
    _, column = torch.nonzero(held, as_tuple=True)
    matrix = csr_matrix(offset, column.int(), held[held != 0], (7, 4))
    dense = torch.rand(4, columns, generator=generator, dtype=dtype)
    turned = torch.rand(columns, 4, generator=generator, dtype=dtype).T
    expected = held @ dense, held @ turned

    def of_nan(tensor: torch.Tensor, *shape: int) -> torch.Tensor:
        return torch.full(shape, torch.nan, dtype=tensor.dtype)

    monkeypatch.setattr(torch.Tensor, "new_empty", of_nan)
    torch.testing.assert_close(
        (sparse_product(matrix, dense), sparse_product(matrix, turned)), expected
    )
