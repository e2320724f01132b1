"""A run folder is made whole or not at all."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from spmm_torch.errors import DataError, OutputError
from spmm_torch.run_folder import new_run


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def test_appears_at_the_end(tmp_path: Path) -> None:
    with new_run(tmp_path / "run") as folder:
        (folder / "a").write_text("1")
        assert not (tmp_path / "run").exists()
        assert folder.parent == tmp_path
    assert names(tmp_path) == ["run"]
    assert names(tmp_path / "run") == ["a"]


def test_parents_are_made(tmp_path: Path) -> None:
    with new_run(str(tmp_path / "runs" / "today" / "run")) as folder:
        (folder / "a").write_text("1")
    assert names(tmp_path / "runs" / "today") == ["run"]


@pytest.mark.parametrize("kind", ["folder", "empty folder", "file", "dangling link"])
def test_what_exists_is_refused_and_untouched(tmp_path: Path, kind: str) -> None:
    run = tmp_path / "run"
    if kind == "file":
        run.write_text("mine")
    elif kind == "dangling link":
        run.symlink_to(tmp_path / "nowhere")
    else:
        run.mkdir()
        if kind == "folder":
            (run / "mine").write_text("mine")
    with pytest.raises(OutputError, match=r"run exists; expected a new name"), new_run(run):
        pytest.fail("the body must not run")
    assert names(tmp_path) == ["run"]
    if kind == "folder":
        assert (run / "mine").read_text() == "mine"


@pytest.mark.parametrize("error", [DataError("bad"), RuntimeError("bug"), KeyboardInterrupt()])
def test_failure_leaves_nothing(tmp_path: Path, error: BaseException) -> None:
    with pytest.raises(type(error)), new_run(tmp_path / "run") as folder:
        (folder / "deep").mkdir()
        (folder / "deep" / "a").write_text("1")
        raise error
    assert names(tmp_path) == []


def test_failure_leaves_no_new_parents(tmp_path: Path) -> None:
    (tmp_path / "old").mkdir()
    run = tmp_path / "old" / "new" / "newer" / "run"
    with pytest.raises(DataError), new_run(run):
        raise DataError("bad")
    assert names(tmp_path) == ["old"]
    assert names(tmp_path / "old") == []


def test_failed_disk_is_one_sentence(tmp_path: Path) -> None:
    message = r"run folder .*run cannot be written \(disk full\); check the disk"
    with pytest.raises(OutputError, match=message), new_run(tmp_path / "run") as folder:
        (folder / "a").write_text("1")
        raise OSError("disk full")
    assert names(tmp_path) == []


def test_failed_rename_leaves_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: object) -> None:
        raise PermissionError("no")

    monkeypatch.setattr(os, "replace", fail)
    with pytest.raises(OutputError, match="cannot be written"), new_run(tmp_path / "run"):
        pass
    assert names(tmp_path) == []


def test_parent_that_is_a_file(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("mine")
    with pytest.raises(OutputError, match="cannot be written"), new_run(tmp_path / "file" / "run"):
        pytest.fail("the body must not run")
    assert (tmp_path / "file").read_text() == "mine"
