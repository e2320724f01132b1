"""What lies in the place of a wanted file is told in words, and never waited for."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from spmm_torch.data import load_btf
from spmm_torch.errors import DataError, OutputError
from spmm_torch.runtime.foreign import absence
from spmm_torch.runtime.tensor_file import read


@pytest.fixture
def places(tmp_path: Path) -> Path:
    """A folder of paths at which there is nothing to read."""
    (tmp_path / "loop").symlink_to("loop")
    (tmp_path / "lost").symlink_to("moved.zip")
    (tmp_path / "file").touch()
    if hasattr(os, "mkfifo"):
        os.mkfifo(tmp_path / "pipe")
    return tmp_path


@pytest.mark.parametrize(
    ("name", "reason"),
    [
        ("none", "does not exist"),
        ("file/none", "does not exist"),
        ("nul\0", "does not exist"),
        ("loop", "is a link to loop, where nothing lies"),
        ("lost", "is a link to moved.zip, where nothing lies"),
        ("n" * 300, "cannot be reached (File name too long)"),
        ("pipe", "is neither a file nor a folder, but a pipe or a device"),
    ],
)
def test_absence(places: Path, name: str, reason: str) -> None:
    if name == "pipe" and not (places / name).exists():
        pytest.skip("needs named pipes")
    assert absence(places / name) == reason
    with pytest.raises(DataError) as btf:
        load_btf(places / name)
    assert f"{name} {reason}; expected" in str(btf.value)
    with pytest.raises(OutputError) as model:
        read(places / name, "cpu")
    assert f"{name} {reason}; expected" in str(model.value)


def test_files_and_folders_are_there(places: Path) -> None:
    assert absence(places) is None
    assert absence(places / "file") is None


@pytest.mark.parametrize("suffix", [".zip", ".npz", ".btf", ".parquet"])
def test_an_empty_file_is_called_so(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"wool{suffix}"
    path.touch()
    with pytest.raises(DataError, match=r"is an empty file, of 0 bytes; .*copy or download"):
        load_btf(path)
