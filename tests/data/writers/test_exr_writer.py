"""Folders of EXR pictures hold the values in the source's own precision."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import imagecodecs
import numpy as np
import pytest
import torch

from spmm_torch.data import load_btf
from spmm_torch.data.codecs import openexr
from spmm_torch.data.file_names import parse_angles
from spmm_torch.data.picture_grid import unit_vectors
from spmm_torch.data.writers import WRITERS, write_exr_folder
from spmm_torch.data.writers.base import NoSettings
from spmm_torch.errors import OutputError
from tests.data.test_picture_set import make_files, write_zip
from tests.planted.btfs import picture_btf


def decoded(folder: Path) -> dict[str, np.ndarray]:
    """Every picture of a folder by its number, which counts light * V + view."""
    files = sorted(folder.rglob("*.exr"), key=lambda file: file.name)
    return {file.name[:5]: openexr.decode(file.read_bytes()) for file in files}


@pytest.mark.parametrize("dtype", [np.float16, np.float32])
def test_values_and_names(tmp_path: Path, values: np.ndarray, dtype: type) -> None:
    values = (values * 30_000).astype(dtype)
    source = picture_btf(values)
    calls: list[tuple[int, int]] = []
    write_exr_folder(tmp_path / "a", source, progress=lambda *call: calls.append(call))
    assert calls == [(1, 2), (2, 2)]
    pictures = decoded(tmp_path / "a")
    assert list(pictures) == [f"{number:05}" for number in range(6)]
    for number, picture in pictures.items():
        light, view = divmod(int(number), 2)
        assert picture.dtype == dtype
        np.testing.assert_array_equal(picture, values[view, light])
    for file in (tmp_path / "a").rglob("*.exr"):
        light, view = divmod(int(file.name[:5]), 2)
        read = unit_vectors(parse_angles(file.name))
        torch.testing.assert_close(read, torch.stack((source.view[view], source.light[light])))
        assert file.parent.name == "tv000_pv000" if view == 0 else "tv030_pv000"
    assert [file.name for file in tmp_path.iterdir()] == ["a"]


def test_precision(tmp_path: Path, values: np.ndarray) -> None:
    values = values.astype(np.float16).astype(np.float32)
    for number, (source_bytes, maximum, expected) in enumerate(
        [
            (1, 1.5, np.float16),
            (2, 65504.0, np.float16),
            (2, 65505.0, np.float32),
            (4, 1.5, np.float32),
        ]
    ):
        values[1, 2, 3, 4] = maximum
        source = picture_btf(values)
        source.bytes_per_value = source_bytes
        write_exr_folder(tmp_path / str(number), source)
        pictures = decoded(tmp_path / str(number)).values()
        assert {picture.dtype for picture in pictures} == {np.dtype(expected)}
        assert max(picture.max() for picture in pictures) == maximum


@pytest.mark.parametrize("kind", ["exr", "npz"])
def test_integers_of_16_bits_are_not_rounded_to_half_floats(tmp_path: Path, kind: str) -> None:
    """65,536 levels need more than the 11 bits of a half float."""
    codes = np.random.default_rng(3).integers(1, 1 << 16, (3, 3, 4, 5, 3), dtype=np.uint16)
    names = [name for name, _ in make_files((codes >> 8).astype(np.uint8))]
    files = [imagecodecs.png_encode(picture) for picture in codes.reshape(-1, 4, 5, 3)]
    source = write_zip(tmp_path / "a.zip", list(zip(names, files, strict=True)))
    source = load_btf(source, gamma=1.0)
    assert source.bytes_per_value == 2
    written = tmp_path / ("b" if kind == "exr" else "b.npz")
    WRITERS[kind].write(written, source, NoSettings())
    assert torch.equal(load_btf(written).texels(), source.texels())


def test_existing_folder_is_kept(tmp_path: Path, values: np.ndarray) -> None:
    (tmp_path / "a").mkdir()
    (tmp_path / "a" / "mine").write_text("mine")
    with pytest.raises(OutputError, match="a exists"):
        write_exr_folder(tmp_path / "a", picture_btf(values))
    assert [file.name for file in tmp_path.rglob("*")] == ["a", "mine"]


def test_full_disk(tmp_path: Path, full_disk: Callable) -> None:
    source = picture_btf(np.random.default_rng(1).random((1, 2, 50, 50, 3), dtype=np.float32))
    with full_disk(20_000), pytest.raises(OutputError, match="cannot be written"):
        write_exr_folder(tmp_path / "a", source)
    assert not list(tmp_path.iterdir())
