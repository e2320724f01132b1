"""Sparse matrices bring no notice, which every command would print."""

from __future__ import annotations

import subprocess
import sys

import torch

from spmm_torch.runtime.sparse import csr_matrix

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
