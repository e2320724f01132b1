"""NPZ files hold the BTF exactly, in any version of NumPy."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import torch

from spmm_torch.data import load_btf
from spmm_torch.data.writers import write_npz
from spmm_torch.errors import OutputError
from tests.planted.btfs import picture_btf


@pytest.mark.parametrize("dtype", [np.float16, np.float32])
def test_round_trip(tmp_path: Path, values: np.ndarray, dtype: type) -> None:
    source = picture_btf(values.astype(dtype) * 900)
    calls: list[tuple[int, int]] = []
    write_npz(tmp_path / "a.npz", source, progress=lambda *call: calls.append(call))
    assert calls == [(1, 2), (2, 2)]
    with np.load(tmp_path / "a.npz") as arrays:
        assert arrays["values"].dtype == dtype
        np.testing.assert_array_equal(arrays["values"], values.astype(dtype) * 900)
    found = load_btf(tmp_path / "a.npz")
    assert torch.equal(found.texels(), source.texels())
    assert torch.equal(found.view, source.view) and torch.equal(found.light, source.light)
    write_npz(tmp_path / "b.npz", source)
    assert (tmp_path / "a.npz").read_bytes() == (tmp_path / "b.npz").read_bytes()


def test_halves_that_grew_become_singles(tmp_path: Path, values: np.ndarray) -> None:
    values[1, 2, 3, 4, 0] = 70_000.0
    source = picture_btf(values)
    source.bytes_per_value = 2  # as of a file that holds factors as halves
    write_npz(tmp_path / "a.npz", source)
    assert torch.equal(load_btf(tmp_path / "a.npz").texels(), source.texels())


def test_full_disk(tmp_path: Path, values: np.ndarray, full_disk: Callable) -> None:
    source = picture_btf(np.tile(values, (1, 1, 20, 20, 1)))
    with full_disk(100_000), pytest.raises(OutputError, match="cannot be written"):
        write_npz(tmp_path / "a.npz", source)
    assert not list(tmp_path.iterdir())
