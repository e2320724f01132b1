"""Files and folders appear whole or not at all."""

from __future__ import annotations

import zipfile
from pathlib import Path

import pytest

from spmm_torch.errors import OutputError
from spmm_torch.runtime.atomic import new_file, new_folder, zip_member


def test_file(tmp_path: Path) -> None:
    target = tmp_path / "a"
    target.write_text("old")
    with new_file(target) as temporary:
        temporary.write_text("new")
        assert target.read_text() == "old"
        assert temporary.parent == tmp_path and temporary.name.startswith(".")
    assert target.read_text() == "new"
    assert [file.name for file in tmp_path.iterdir()] == ["a"]


def test_folder(tmp_path: Path) -> None:
    with new_folder(str(tmp_path / "a")) as temporary:
        (temporary / "b").write_text("new")
        assert not (tmp_path / "a").exists()
    assert [file.name for file in tmp_path.rglob("*")] == ["a", "b"]
    with pytest.raises(OutputError, match="exists"), new_folder(tmp_path / "a"):
        pass
    assert (tmp_path / "a" / "b").read_text() == "new"


@pytest.mark.parametrize("new", [new_file, new_folder])
@pytest.mark.parametrize(
    ("raised", "seen"), [(OSError("disk full"), OutputError), (KeyboardInterrupt(), None)]
)
def test_failures_leave_nothing(tmp_path: Path, new: object, raised: object, seen: object) -> None:
    with pytest.raises(seen or type(raised)) as caught, new(tmp_path / "a") as temporary:
        (temporary / "b" if temporary.is_dir() else temporary).write_text("half")
        raise raised
    if seen:
        assert "a cannot be written (disk full)" in str(caught.value)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("new", [new_file, new_folder])
def test_no_place(tmp_path: Path, new: object) -> None:
    with pytest.raises(OutputError, match="cannot be written"), new(tmp_path / "no" / "a") as path:
        path.write_text("x")
    assert not list(tmp_path.iterdir())


def test_members_have_no_time(tmp_path: Path) -> None:
    with zipfile.ZipFile(tmp_path / "a.zip", "w") as archive:
        archive.writestr(zip_member("x/y"), b"12")
        (info,) = archive.infolist()
    assert (info.date_time, info.compress_type) == ((1980, 1, 1, 0, 0, 0), zipfile.ZIP_STORED)
