"""Codes in memory and in a file."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch
from torch import Tensor

from spmm_torch.data.codes import FileCodes, Index, MemoryCodes, ViewCodes
from spmm_torch.errors import OutputError
from tests.planted.pictures import random_codes

TEXELS, PAIRS, LIGHTS = 11, 6, 2
INDICES: dict[str, Index] = {
    "all": None,
    "slice": slice(3, 8),
    "every third": slice(1, 10, 3),
    "beyond the end": slice(9, 99),
    "empty slice": slice(4, 4),
    "mask": torch.arange(TEXELS) % 3 == 1,
    "empty mask": torch.zeros(TEXELS, dtype=torch.bool),
    "any order, repeats": torch.tensor([10, 0, 4, 4, 9]),
    "int32": torch.tensor([7, 2], dtype=torch.int32),
    "empty": torch.empty(0, dtype=torch.long),
}


@pytest.fixture
def codes(kind: str) -> np.ndarray:
    return random_codes(kind, (TEXELS, PAIRS))


@pytest.fixture
def file_codes(codes: np.ndarray, tmp_path: Path) -> FileCodes:
    np.save(tmp_path / "a.npy", codes)
    return FileCodes(tmp_path / "a.npy")


def in_memory(codes: np.ndarray) -> tuple[MemoryCodes, ViewCodes]:
    """The same codes `[T, D, B]` texel by texel and view by view."""
    by_texel = torch.from_numpy(codes)
    by_view = by_texel.unflatten(1, (-1, LIGHTS)).transpose(0, 1).contiguous()
    return MemoryCodes(by_texel), ViewCodes(by_view)


@pytest.mark.parametrize("case", INDICES)
def test_rows_are_the_same_in_memory_and_in_a_file(
    codes: np.ndarray, file_codes: FileCodes, case: str
) -> None:
    index = INDICES[case]
    expected = codes[slice(None) if index is None else index]
    for place in (*in_memory(codes), file_codes):
        rows = place.rows(index)
        assert rows.dtype == torch.from_numpy(codes).dtype
        np.testing.assert_array_equal(rows.numpy(), expected)


@pytest.mark.parametrize(("start", "stop"), [(0, PAIRS), (2, 3), (4, 6), (3, 3)])
def test_columns_are_the_same_in_memory_and_in_a_file(
    codes: np.ndarray, file_codes: FileCodes, start: int, stop: int
) -> None:
    for place in (*in_memory(codes), file_codes):
        np.testing.assert_array_equal(place.columns(start, stop).numpy(), codes[:, start:stop])


def test_strips_are_the_same_in_memory_and_in_a_file(
    codes: np.ndarray, file_codes: FileCodes
) -> None:
    texel, view = torch.tensor([4, 0, 10, 4]), torch.tensor([2, 0, 1, 2])
    expected = codes.reshape(TEXELS, -1, LIGHTS, codes.shape[2])[texel, view]
    for place in (*in_memory(codes), file_codes):
        np.testing.assert_array_equal(place.strips(texel, view, LIGHTS).numpy(), expected)


def test_a_file_is_not_written_to(codes: np.ndarray, file_codes: FileCodes) -> None:
    file_codes.rows(None).zero_()
    file_codes.columns(0, 2).zero_()
    np.testing.assert_array_equal(np.load(file_codes.path), codes)


def test_of_a_large_file_only_what_is_asked_for_is_read(tmp_path: Path) -> None:
    path = tmp_path / "a.npy"
    shape = (1 << 12, 1 << 20, 3)  # 12 GB, nearly all of it a hole
    np.lib.format.open_memmap(path, mode="w+", dtype=np.uint8, shape=shape)[-1, -1] = 7
    rows = FileCodes(path).rows(torch.tensor([5, shape[0] - 1]))
    assert rows.shape == (2, *shape[1:])
    assert rows.nonzero().tolist() == [[1, shape[1] - 1, c] for c in range(3)]


def test_a_file_that_vanishes_or_shrinks(file_codes: FileCodes) -> None:
    content = file_codes.path.read_bytes()
    for damage in (lambda: file_codes.path.write_bytes(content[:-1]), file_codes.path.unlink):
        damage()
        for read in (lambda: file_codes.rows(slice(0, 2)), lambda: file_codes.columns(0, 1)):
            with pytest.raises(OutputError, match="cannot be read any more") as error:
                read()
            assert str(file_codes.path) in str(error.value) and "\n" not in str(error.value)


def test_indices_and_masks_name_the_same_texels() -> None:
    mask: Tensor = INDICES["mask"]  # type: ignore[assignment]
    codes = MemoryCodes(torch.arange(TEXELS * 2).view(TEXELS, 1, 2))
    assert torch.equal(codes.rows(mask), codes.rows(mask.nonzero().flatten()))
