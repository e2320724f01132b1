"""Codes in memory and in a file, and the values they stand for, against naive formulas."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
import torch
from torch import Tensor

from spmm_torch.data import codes as module
from spmm_torch.data.codecs.radiance import RgbeExpansion
from spmm_torch.data.codes import (
    DepthExpansion,
    Expansion,
    FileCodes,
    FloatExpansion,
    Index,
    MemoryCodes,
    TableExpansion,
)
from spmm_torch.errors import OutputError
from tests.planted.pictures import random_codes

TEXELS, PAIRS = 11, 6
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


@pytest.mark.parametrize("case", INDICES)
def test_rows_are_the_same_in_memory_and_in_a_file(
    codes: np.ndarray, file_codes: FileCodes, case: str
) -> None:
    index = INDICES[case]
    expected = codes[slice(None) if index is None else index]
    for place in (MemoryCodes(torch.from_numpy(codes)), file_codes):
        rows = place.rows(index)
        assert rows.dtype == torch.from_numpy(codes).dtype
        np.testing.assert_array_equal(rows.numpy(), expected)


@pytest.mark.parametrize(("start", "stop"), [(0, PAIRS), (2, 3), (4, 6), (3, 3)])
def test_columns_are_the_same_in_memory_and_in_a_file(
    codes: np.ndarray, file_codes: FileCodes, start: int, stop: int
) -> None:
    for place in (MemoryCodes(torch.from_numpy(codes)), file_codes):
        np.testing.assert_array_equal(place.columns(start, stop).numpy(), codes[:, start:stop])


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


def test_rgbe_is_ldexp() -> None:
    mantissa, exponent = np.mgrid[0:256, 0:256]
    codes = np.stack((mantissa, 255 - mantissa, mantissa ^ 0x55, exponent), -1).astype(np.uint8)
    exact = np.ldexp(codes[..., :3].astype(np.float64), exponent[..., None] - 136)
    exact[exponent == 0] = 0.0
    values = RgbeExpansion()(torch.from_numpy(codes))
    assert values.dtype == torch.float32
    np.testing.assert_array_equal(values.double().numpy(), exact)
    assert float(values.max()) == math.ldexp(255.0, 255 - 136)  # nothing is cut off


@pytest.mark.parametrize("gamma", [1.0, 2.2, 0.5])
def test_eight_bits_are_a_power(gamma: float) -> None:
    codes = torch.arange(256, dtype=torch.uint8).view(4, 64)
    expected = [(code / 255.0) ** gamma for code in range(256)]
    values = TableExpansion.gamma(gamma)(codes)
    torch.testing.assert_close(values, torch.tensor(expected).view(4, 64), rtol=1e-7, atol=0)
    assert (values[0, 0], values[-1, -1]) == (0.0, 1.0)


@pytest.mark.parametrize("gamma", [1.0, 2.2, 0.5])
def test_sixteen_bits_are_a_power(gamma: float) -> None:
    codes = torch.from_numpy(np.arange(65536, dtype=np.uint16).reshape(4, -1))
    expected = (np.arange(65536) / 65535.0) ** gamma
    values = DepthExpansion(gamma)(codes)
    np.testing.assert_allclose(values.flatten().numpy(), expected, rtol=1e-7)


@pytest.mark.parametrize("kind", ["uint8", "uint16", "float16", "float32"])
def test_the_type_of_codes_tells_their_depth(kind: str) -> None:
    """Codes of 8 and 16 bits are encoded, floats are not."""
    codes = torch.from_numpy(random_codes(kind, (3, 5)))
    white = 1.0 if codes.is_floating_point() else float(np.iinfo(kind).max)
    exact = codes.double() / white
    expected = exact if codes.is_floating_point() else exact**2.2
    torch.testing.assert_close(DepthExpansion(2.2)(codes), expected.float())


@pytest.mark.parametrize("kind", ["uint8", "uint16"])
def test_values_do_not_depend_on_the_blocks(monkeypatch: pytest.MonkeyPatch, kind: str) -> None:
    expand = DepthExpansion(2.2)
    codes = torch.from_numpy(random_codes(kind, (9, 8)))
    whole = expand(codes)
    monkeypatch.setattr(module, "LOOKUP_CHUNK", 7)
    assert torch.equal(expand(codes), whole)
    assert torch.equal(expand(codes[:, 2:5]), whole[:, 2:5])  # apart in memory
    assert torch.equal(expand(codes[::2]), whole[::2])
    assert expand(codes[:0]).shape == (0, 8, 3)


@pytest.mark.parametrize("dtype", [torch.float16, torch.float32])
def test_floats_stay_as_they_are(dtype: torch.dtype) -> None:
    largest = torch.finfo(dtype).max
    codes = torch.tensor([0.0, torch.finfo(dtype).tiny, 1.0, largest], dtype=dtype)
    values = FloatExpansion()(codes)
    assert values.dtype == torch.float32
    assert torch.equal(values.to(dtype), codes)


def test_bounds(kind: str) -> None:
    expansions: dict[str, Expansion] = {
        "uint8": TableExpansion.gamma(2.2),
        "uint16": DepthExpansion(2.2),
        "rgbe": RgbeExpansion(),
    }
    expand = expansions.get(kind, FloatExpansion())
    codes = torch.from_numpy(random_codes(kind, (4, 5), seed=3))
    values = expand(codes)
    assert expand.bounds(codes) == (float(values.min()), float(values.max()))


@pytest.mark.parametrize("dtype", [torch.float16, torch.float32])
def test_bounds_tell_of_nan(dtype: torch.dtype) -> None:
    codes = torch.ones(3, 4, 5, dtype=dtype)
    codes[1, 2, 3] = math.nan
    assert all(map(math.isnan, FloatExpansion().bounds(codes)))


@pytest.mark.gpu
def test_same_bits_on_cuda(kind: str) -> None:
    codes = torch.from_numpy(random_codes(kind, (40, 50)))
    expansions = {"uint8": TableExpansion.gamma(2.2), "rgbe": RgbeExpansion()}
    expand = expansions.get(kind, FloatExpansion())
    assert torch.equal(expand(codes.cuda()).cpu(), expand(codes))


def test_indices_and_masks_name_the_same_texels() -> None:
    mask: Tensor = INDICES["mask"]  # type: ignore[assignment]
    codes = MemoryCodes(torch.arange(TEXELS * 2).view(TEXELS, 1, 2))
    assert torch.equal(codes.rows(mask), codes.rows(mask.nonzero().flatten()))
