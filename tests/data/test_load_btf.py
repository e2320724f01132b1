"""The entry: which reader a path gets, and what is said when none fits."""

from __future__ import annotations

import bz2
import gzip
import lzma
import tarfile
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import torch

from spmm_torch.data import load_btf, sample_path
from spmm_torch.errors import ConfigError, DataError


def empty_folder(path: Path) -> None:
    path.mkdir()


def foreign_folder(path: Path) -> None:
    path.mkdir()
    (path / "notes.txt").write_text("hello")


def text_file(path: Path) -> None:
    path.write_text("hello")


def foreign_zip(path: Path) -> None:
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("holiday.jpg", b"hello")


def empty_zip(path: Path) -> None:
    with zipfile.ZipFile(path, "w"):
        pass


def half_a_zip(path: Path) -> None:
    path.write_bytes(sample_path().read_bytes()[:100_000])


def held(content: bytes) -> Callable[[Path], int]:
    """What makes a file of some content."""
    return lambda path: path.write_bytes(content)


def tar(path: Path) -> None:
    with tarfile.open(path, "w") as archive:
        archive.add(__file__, "notes.txt")


def folder_of_an_archive(path: Path) -> None:
    path.mkdir()
    (path / "a.tar.gz").write_bytes(gzip.compress(b"tar"))


def nothing(path: Path) -> None:
    assert not path.exists()


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (nothing, "does not exist"),
        (empty_folder, "is an empty folder"),
        (foreign_folder, "holds no BTF pictures"),
        (text_file, "is neither a complete zip nor a folder"),
        (half_a_zip, "is neither a complete zip nor a folder"),
        (foreign_zip, "is a zip without BTF pictures"),
        (empty_zip, "is a zip without BTF pictures"),
        (held(b"7z\xbc\xaf\x27\x1c"), "is a 7z archive; expected .*; unpack it by `7z x`"),
        (held(b"Rar!\x1a\x07\1\0"), "is a RAR archive; expected .*; unpack it by `unrar x`"),
        (held(gzip.compress(b"tar")), "compressed by gzip; expected .*; unpack it by `tar -xf`"),
        (held(lzma.compress(b"tar")), "is compressed by xz"),
        (held(bz2.compress(b"tar")), "is compressed by bzip2"),
        (held(b"\x28\xb5\x2f\xfd"), "is compressed by zstd"),
        (tar, "is a tar archive; expected .*; unpack it by `tar -xf` and give the folder"),
        (folder_of_an_archive, "holds no BTF pictures; expected .*; unpack 'a.tar.gz' and give"),
        (held(b"version https://git-lfs.github.com/spec/v1\n"), "is a pointer of Git LFS"),
        (held(b"\n<!DOCTYPE html><html>"), "is a web page, .*; download the file again"),
    ],
)
def test_no_reader(tmp_path: Path, make: object, message: str) -> None:
    path = tmp_path / "input.zip"
    make(path)
    with pytest.raises(DataError, match=message) as error:
        load_btf(path)
    text = str(error.value)
    assert str(path) in text and "expected" in text and "\n" not in text


def test_content_decides_not_the_extension(tmp_path: Path) -> None:
    directions = np.array([[0, 0, 1]], np.float32)
    np.savez(
        tmp_path / "a.npz", values=np.ones((1, 1, 1, 1, 3), "f4"), view=directions, light=directions
    )
    path = (tmp_path / "a.npz").rename(tmp_path / "a.zip")
    assert load_btf(path).pair_count == 1
    (tmp_path / "b.dat").write_bytes(sample_path().read_bytes())
    assert load_btf(str(tmp_path / "b.dat")).pair_count == 6561


def test_damaged_directory_of_a_zip(tmp_path: Path) -> None:
    content = bytearray(sample_path().read_bytes())
    where = content.rfind(b"PK\x01\x02")
    content[where : where + 4] = b"oops"
    (tmp_path / "a.zip").write_bytes(content)
    with pytest.raises(DataError, match="cannot be opened"):
        load_btf(tmp_path / "a.zip")


def test_cosine_that_is_missing_is_multiplied(tmp_path: Path) -> None:
    directions = np.array([[0.0, 0.0, 1.0], [0.6, 0.0, 0.8]], np.float32)
    values = np.random.default_rng(0).random((2, 2, 3, 4, 3), dtype=np.float32)
    np.savez(tmp_path / "a.npz", values=values, view=directions, light=directions)
    included = load_btf(tmp_path / "a.npz")
    missing = load_btf(tmp_path / "a.npz", cosine="missing")
    wi, _ = included.pairs()
    torch.testing.assert_close(missing.texels(), included.texels() * wi[:, 2:])
    torch.testing.assert_close(missing.picture(1, 1), included.picture(1, 1) * 0.8)
    part = missing.restricted(lights=torch.tensor([1]))
    torch.testing.assert_close(part.texels(), missing.texels()[:, [1, 3]])
    with pytest.raises(ConfigError, match="cosine is 'maybe'; expected one of auto"):
        load_btf(tmp_path / "a.npz", cosine="maybe")
