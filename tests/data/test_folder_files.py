"""Folders with links: all that they lead to is read, and what cannot be is named."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest
import torch

from spmm_torch.data import load_btf
from spmm_torch.data.folder_files import folder_files
from spmm_torch.errors import DataError
from tests.data.test_picture_set import linear, make_files, write_folder

CODES = np.random.default_rng(1).integers(0, 256, (3, 3, 4, 5, 3), dtype=np.uint8)
VIEW = "TEST/MANYFILES/tv015_pv060"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A picture set of 3 views in folders of their own."""
    return write_folder(tmp_path / "wool", make_files(CODES))


def moved(folder: Path, names: list[str]) -> Path:
    """A folder elsewhere to which some folders or files were moved, with links in their place."""
    other = folder.with_name("elsewhere")
    other.mkdir()
    for number, name in enumerate(names):
        (folder / name).rename(other / f"{number}")
        (folder / name).symlink_to(other / f"{number}")
    return other


@pytest.mark.parametrize("names", [[VIEW], ["TEST"], [VIEW, f"{VIEW[:-9]}075_pv345"]])
def test_links_are_followed(folder: Path, names: list[str]) -> None:
    moved(folder, names)
    torch.testing.assert_close(load_btf(folder).texels(), linear(CODES))


def test_pictures_that_are_links(folder: Path) -> None:
    names = folder_files(folder)
    moved(folder, names)
    assert folder_files(folder) == names
    torch.testing.assert_close(load_btf(folder).texels(), linear(CODES))


def test_a_link_to_nothing(folder: Path) -> None:
    names = folder_files(folder)[:2]
    other = moved(folder, names)
    for file in other.iterdir():
        file.unlink()
    with pytest.raises(DataError, match="which cannot be opened") as error:
        load_btf(folder)
    assert f"link {names[0]!r} in {folder} (and 1 more) leads to" in str(error.value)


def test_a_link_to_a_folder_that_is_gone(folder: Path) -> None:
    (folder / VIEW).rename(folder.with_name("gone"))
    (folder / VIEW).symlink_to(folder.with_name("nowhere"))
    with pytest.raises(DataError, match=f"link '{VIEW}' in"):
        load_btf(folder)


@pytest.mark.parametrize("target", [".", "..", "../..", "loop"])
def test_loops_are_refused(folder: Path, target: str) -> None:
    (folder / VIEW / "loop").symlink_to(target)
    with pytest.raises(DataError, match=f"link '{VIEW}/loop' in"):
        load_btf(folder)


def test_hidden_links_do_not_count(folder: Path) -> None:
    (folder / ".latest").symlink_to("nowhere")
    (folder / ".loop").symlink_to(".")
    torch.testing.assert_close(load_btf(folder).texels(), linear(CODES))


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no named pipes")
def test_what_is_no_file_is_named(folder: Path) -> None:
    os.mkfifo(folder / "a.png")  # to read it would wait for ever
    with pytest.raises(DataError, match=r"'a\.png' in .* is neither a file nor a folder"):
        load_btf(folder)


def test_a_folder_that_cannot_be_read(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    scandir = os.scandir

    def refusing(path: object) -> object:
        if str(path).endswith(VIEW):
            raise PermissionError(13, "Permission denied", str(path))
        return scandir(path)

    monkeypatch.setattr(os, "scandir", refusing)
    with pytest.raises(DataError, match=f"Permission denied: .*{VIEW}.*check its permissions"):
        load_btf(folder)
