"""Zips as other programs make them, and a BTF one level down."""

from __future__ import annotations

import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import torch

from spmm_torch.cli.main import main
from spmm_torch.data import load_btf
from spmm_torch.data.pictures import list_files
from spmm_torch.data.writers import write_npz
from spmm_torch.errors import DataError, OutputError
from tests.data.test_picture_set import linear, make_files, write_folder, write_zip

Files = list[tuple[str, bytes]]

CODES = np.random.default_rng(1).integers(0, 256, (3, 3, 4, 5, 3), dtype=np.uint8)
METHOD, FLAGS = 10, 8  # places in the central entry of a member
CENTRAL = b"PK\x01\x02"


@pytest.fixture
def files() -> Files:
    return make_files(CODES)


def holds_the_values(path: Path) -> bool:
    return torch.allclose(load_btf(path).texels(), linear(CODES))


def windows_zip(path: Path, files: Files) -> Path:
    """A zip with back-slashes and entries of folders, as .NET made them."""
    with zipfile.ZipFile(path, "w") as archive:
        for name, content in [("TEST/", b""), ("TEST/MANYFILES/", b""), *files]:
            member = zipfile.ZipInfo()
            member.filename = name.replace("/", "\\")
            archive.writestr(member, content)
    return path


def from_the_folder(path: Path, files: Files) -> Path:
    return write_zip(path, [("./", b""), *((f"./{name}", content) for name, content in files)])


def hidden_top(path: Path, files: Files) -> Path:
    notes = [("readme.txt", b"hello"), ("__MACOSX/.wool/x.png", b"mac")]
    return write_zip(path, [*notes, *((f".wool/{name}", content) for name, content in files)])


def zip_in_a_zip(path: Path, files: Files) -> Path:
    inner = write_zip(path.with_name("inner.zip"), files).read_bytes()
    return write_zip(path, [("preview.png", b"x"), ("WOOL/inner.ZIP", inner)])


@pytest.mark.parametrize("make", [windows_zip, from_the_folder, hidden_top, zip_in_a_zip])
def test_zips_of_other_programs(tmp_path: Path, files: Files, make: Callable) -> None:
    path = make(tmp_path / "WOOL.zip", files)
    assert holds_the_values(path)
    assert load_btf(path).name == "WOOL"
    cached = load_btf(path).load(memory=0, cache=tmp_path / "cache")
    torch.testing.assert_close(cached.texels(), linear(CODES))


@pytest.mark.parametrize("name", ["a//b.png", "a/./b.png", "./a/b.png", ".//a/b.png", "a\\b.png"])
def test_names_in_a_zip_are_those_of_a_folder(tmp_path: Path, name: str) -> None:
    assert list_files(write_zip(tmp_path / "a.zip", [(name, b"x")])) == ["a/b.png"]


def test_a_list_of_names_follows_the_zip(tmp_path: Path) -> None:
    path = write_zip(tmp_path / "a.zip", [("a.png", b"x")])
    assert list_files(path) == ["a.png"]
    write_zip(path, [("a.png", b"x"), ("b.png", b"x")])
    assert list_files(path) == ["a.png", "b.png"]


def test_an_inner_zip_follows_the_outer_one(tmp_path: Path, files: Files) -> None:
    path = zip_in_a_zip(tmp_path / "WOOL.zip", files)
    assert holds_the_values(path)
    write_zip(path, files[:1])
    assert load_btf(path).pair_count == 1


def test_an_inner_zip_without_space(
    tmp_path: Path, files: Files, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = zip_in_a_zip(tmp_path / "WOOL.zip", files)

    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("shutil.copyfileobj", full)
    with pytest.raises(OutputError, match="'WOOL/inner.ZIP' in .* cannot be unpacked.*No space"):
        load_btf(path)


def test_an_npz_in_a_zip(tmp_path: Path, files: Files) -> None:
    btf = load_btf(write_zip(tmp_path / "a.zip", files))
    write_npz(tmp_path / "a.npz", btf)
    packed = write_zip(tmp_path / "b.zip", [("a.zip", (tmp_path / "a.npz").read_bytes())])
    assert torch.equal(load_btf(packed).texels(), btf.texels())


def test_a_folder_that_holds_the_btf(tmp_path: Path, files: Files) -> None:
    folder = tmp_path / "download"
    (folder / "WOOL").mkdir(parents=True)
    (folder / "readme.txt").write_text("hello")
    inner = write_zip(folder / "WOOL" / "a.zip", files)
    btf = load_btf(folder)
    assert btf.path == str(inner)
    torch.testing.assert_close(btf.texels(), linear(CODES))
    write_zip(folder / "b.zip", files)
    with pytest.raises(DataError, match=r"holds 2 BTFs, 'WOOL/a.zip' and 'b.zip' among them"):
        load_btf(folder)


def test_a_zip_that_holds_several(tmp_path: Path, files: Files) -> None:
    inner = write_zip(tmp_path / "inner.zip", files).read_bytes()
    path = write_zip(tmp_path / "all.zip", [("a.zip", inner), ("b.zip", inner)])
    with pytest.raises(DataError, match="without BTF pictures.*unpack 'a.zip' and give that"):
        load_btf(path)


def patched(path: Path, place: int, value: int) -> Path:
    """The zip with another byte in the central entry of its last member."""
    content = bytearray(path.read_bytes())
    content[content.rfind(CENTRAL) + place] = value
    path.write_bytes(content)
    return path


@pytest.mark.parametrize(
    ("place", "value", "fault"),
    [
        (METHOD, 9, "is compressed by Deflate64, which Python cannot undo"),
        (METHOD, 98, "is compressed by PPMd, which Python cannot undo"),
        (FLAGS, 1, "is encrypted"),
    ],
)
def test_members_that_python_cannot_read(
    tmp_path: Path, files: Files, place: int, value: int, fault: str
) -> None:
    path = patched(write_zip(tmp_path / "a.zip", files), place, value)
    with pytest.raises(DataError, match=f"{files[-1][0]!r} in .* {fault}.*unpack the zip") as error:
        load_btf(path)  # before anything is decoded, though the first member is in order
    assert "original data set" not in str(error.value)


def test_a_link_in_a_zip(tmp_path: Path, files: Files) -> None:
    path = write_zip(tmp_path / "a.zip", files[:-1])
    link = zipfile.ZipInfo(files[-1][0])
    link.create_system, link.external_attr = 3, 0o120777 << 16
    with zipfile.ZipFile(path, "a") as archive:
        archive.writestr(link, "../elsewhere.png")
    with pytest.raises(DataError, match="is a link"):
        load_btf(path)


def test_the_same_member_twice(tmp_path: Path, files: Files) -> None:
    with pytest.warns(UserWarning, match="Duplicate name"):
        path = write_zip(tmp_path / "a.zip", [*files, files[0]])
    with pytest.raises(DataError, match="twice"):
        load_btf(path)


def test_what_is_left_out_is_said(
    tmp_path: Path, files: Files, capsys: pytest.CaptureFixture[str]
) -> None:
    rest = [("preview.png", b"x"), (f".old/{files[0][0]}", b"x"), ("readme.txt", b"x")]
    path = write_folder(tmp_path / "a", [*files, *rest])
    (note,) = load_btf(path).notes
    assert note == f"note: no part of the BTF in {path}: '.old/{files[0][0]}' and 1 more"
    assert main(["convert", str(path), "-o", str(tmp_path / "a.npz")]) == 0
    assert note in capsys.readouterr().err


def test_a_btf_beside_the_one_that_is_read_is_said(tmp_path: Path, files: Files) -> None:
    """Be it in a folder of pictures, beside a file, or in the outer zip."""
    folder = write_folder(tmp_path / "a", files)
    write_npz(tmp_path / "b.npz", load_btf(folder))
    npz = (tmp_path / "b.npz").read_bytes()
    inner = write_zip(tmp_path / "c.zip", files).read_bytes()
    for path, lost in (
        (write_folder(tmp_path / "d", [*files, ("other.npz", npz)]), "other.npz"),
        (write_folder(tmp_path / "e", [("b.npz", npz), ("c.zip", inner[:99])]), "c.zip"),
        (write_zip(tmp_path / "f.zip", [("c.zip", inner), ("small.zip", b"x")]), "small.zip"),
    ):
        assert load_btf(path).notes == (f"note: no part of the BTF in {path}: {lost!r}",)


def test_a_file_that_is_listed_twice_is_one_file(tmp_path: Path) -> None:
    """Which Python's own reader takes for an attack [cpython issue 117779]."""
    files = make_files(np.full((3, 3, 4, 5, 3), 99, np.uint8))
    with zipfile.ZipFile(tmp_path / "a.zip", "w") as archive:
        for name, content in files:
            archive.writestr(name, content)
        archive.filelist += [archive.filelist[0], archive.filelist[-1]]
    assert load_btf(tmp_path / "a.zip").load().pair_count == 9


def test_a_name_that_is_no_utf8_is_a_damaged_zip(tmp_path: Path) -> None:
    """Python's own reader raises a UnicodeDecodeError [cpython issue 153426]."""
    source = write_zip(tmp_path / "a.zip", [("\u00e4.png", b"")])
    source.write_bytes(source.read_bytes().replace("\u00e4".encode(), b"\xff\xfe"))
    with pytest.raises(DataError, match="a.zip cannot be opened .*utf-8"):
        load_btf(source)
