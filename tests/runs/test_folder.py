"""A run folder is written whole or not at all, and an unfinished one is resumed."""

from __future__ import annotations

import errno
import json
import os
import shutil
from contextlib import ExitStack
from pathlib import Path

import pytest

from spmm_torch.errors import ConfigError, DataError, OutputError
from spmm_torch.runs import folder
from spmm_torch.runs.folder import STATE, is_finished, new_run, remove_leftovers

THIS, OTHER = {"input": "a.zip", "cluster.count": 4}, {"input": "a.zip", "cluster.count": 5}


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


def keep_stage(folder: Path, name: str = "cluster") -> None:
    (folder / STATE / f"{name}.safetensors").write_bytes(b"finished")


def stopped(run: Path, error: BaseException | None = None) -> Path:
    """An unfinished run with one finished stage; its folder."""
    with pytest.raises(BaseException), new_run(run, THIS) as folder:  # noqa: B017
        keep_stage(folder)
        raise error or KeyboardInterrupt
    return folder


def killed(run: Path) -> Path:
    """What a run leaves that is killed before its first stage ends, its lock file included."""
    folder = run.with_name(f".{run.name}.part")
    (folder / STATE).mkdir(parents=True)
    (folder / STATE / "cluster.safetensors.part").write_bytes(b"half")
    (folder / "fingerprint.json").write_text(json.dumps(OTHER))
    (folder / "lock").touch()
    return folder


@pytest.mark.parametrize("error", [DataError("bad"), RuntimeError("bug"), KeyboardInterrupt()])
def test_failure_keeps_finished_stages(tmp_path: Path, error: BaseException) -> None:
    folder = stopped(tmp_path / "run", error)
    assert names(tmp_path) == [".run.part"]
    assert names(folder / STATE) == ["cluster.safetensors"]


def test_unfinished_run_is_not_gone_on_with_unasked(tmp_path: Path) -> None:
    folder = stopped(tmp_path / "run")
    before = sorted(folder.rglob("*"))
    message = r"^an unfinished run of .*run lies in .*\.run\.part; add --resume to go on with it,"
    with pytest.raises(OutputError, match=message), new_run(tmp_path / "run", THIS):
        pytest.fail("the body must not run")
    assert sorted(folder.rglob("*")) == before


def test_resume(tmp_path: Path) -> None:
    stopped(tmp_path / "run")
    with new_run(tmp_path / "run", THIS, resume=True) as folder:
        assert names(folder / STATE) == ["cluster.safetensors"]
        (folder / "a").write_text("1")
    assert names(tmp_path) == ["run"]
    assert names(tmp_path / "run") == ["a"]


def test_resume_without_leftovers_starts_afresh(tmp_path: Path) -> None:
    with new_run(tmp_path / "run", THIS, resume=True) as folder:
        assert names(folder / STATE) == []
    assert names(tmp_path / "run") == []


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"cluster.count": 5}, r"has cluster\.count = 4, not 5; repeat its command"),
        ({"input": "b.zip"}, r"has other content of the input"),
        ({"seed": 1}, "has seed = None, not 1"),
    ],
)
def test_resume_with_another_setting_names_it(
    tmp_path: Path, change: dict[str, object], message: str
) -> None:
    folder = stopped(tmp_path / "run")
    with (
        pytest.raises(ConfigError, match=message),
        new_run(tmp_path / "run", {**THIS, **change}, resume=True),
    ):
        pytest.fail("the body must not run")
    assert names(folder / STATE) == ["cluster.safetensors"]
    with new_run(tmp_path / "run", THIS, resume=True):
        pass
    assert names(tmp_path) == ["run"]


@pytest.mark.parametrize("resume", [False, True])
def test_kill_before_the_first_stage_is_in_nobodys_way(tmp_path: Path, resume: bool) -> None:
    killed(tmp_path / "run")
    with new_run(tmp_path / "run", THIS, resume) as folder:
        assert json.loads((folder / "fingerprint.json").read_text()) == THIS
    assert names(tmp_path) == ["run"]


@pytest.mark.parametrize("stages", [0, 1])
def test_two_processes_do_not_make_one_run(tmp_path: Path, stages: int) -> None:
    """The second is refused and harms nothing: not what is there, nor what it depends on."""
    with new_run(tmp_path / "run", THIS) as folder:
        for _ in range(stages):
            keep_stage(folder)
        (folder / "a").write_text("1")
        message = "another process is making the run .*run; wait for it"
        with pytest.raises(OutputError, match=message), new_run(tmp_path / "run", OTHER, True):
            pytest.fail("the body must not run")
        assert json.loads((folder / "fingerprint.json").read_text()) == THIS
        assert len(names(folder / STATE)) == stages
    assert names(tmp_path / "run") == ["a"]


def test_process_that_waited_for_a_finished_run_spares_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def finish_meanwhile(_held: ExitStack, _folder: Path, target: Path, _say: object) -> None:
        target.mkdir()
        (target / "a").write_text("1")

    monkeypatch.setattr(folder, "_hold", finish_meanwhile)
    with pytest.raises(OutputError, match="run exists"), new_run(tmp_path / "run", THIS):
        pytest.fail("the body must not run")
    assert names(tmp_path) == ["run"]
    assert names(tmp_path / "run") == ["a"]


@pytest.mark.parametrize("code", [errno.ENOSPC, errno.EDQUOT])
def test_full_disk_is_one_sentence_and_keeps_the_state(tmp_path: Path, code: int) -> None:
    message = (
        r"^the disk is full at run folder .*run \(.*\); free some space and go on with --resume"
    )
    with pytest.raises(OutputError, match=message), new_run(tmp_path / "run", THIS) as folder:
        keep_stage(folder)
        raise OSError(code, os.strerror(code))
    assert names(folder / STATE) == ["cluster.safetensors"]
    with new_run(tmp_path / "run", THIS, resume=True):
        pass
    assert names(tmp_path) == ["run"]


def test_full_disk_at_the_start_leaves_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(folder, "write_atomic", fail)
    with pytest.raises(OutputError, match="disk is full"), new_run(tmp_path / "new" / "run", THIS):
        pytest.fail("the body must not run")
    assert names(tmp_path) == []


@pytest.mark.parametrize(("owner", "step"), [(shutil, "rmtree"), (Path, "unlink")])
def test_kill_while_leftovers_go_loses_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, owner: object, step: str
) -> None:
    """The run has its name by then; a later `--resume` removes the rest."""
    remove = getattr(owner, step)

    def kill(path: Path, *arguments: object, **options: object) -> None:
        if path.is_relative_to(tmp_path / "run"):
            raise KeyboardInterrupt
        remove(path, *arguments, **options)

    with monkeypatch.context() as patch:
        patch.setattr(owner, step, kill)
        with pytest.raises(KeyboardInterrupt), new_run(tmp_path / "run", THIS) as folder:
            keep_stage(folder)
            (folder / "model.safetensors").write_text("1")
    assert is_finished(tmp_path / "run")
    remove_leftovers(tmp_path / "run")
    assert names(tmp_path) == ["run"]
    assert names(tmp_path / "run") == ["model.safetensors"]


def test_only_leftovers_are_removed_from_a_run(tmp_path: Path) -> None:
    (tmp_path / STATE).mkdir()
    (tmp_path / "lock").touch()
    remove_leftovers(tmp_path)
    assert names(tmp_path) == ["lock", STATE]


@pytest.mark.parametrize("name", [".", "..", "/"])
def test_names_of_no_folder_to_make(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(OutputError, match="exists; expected a new name"), new_run(name, THIS):
        pytest.fail("the body must not run")
    assert names(tmp_path) == []


@pytest.mark.parametrize("content", ["", "{", "[]", "7", None])
def test_a_fingerprint_that_cannot_be_read_stops_nothing(
    tmp_path: Path, content: str | None
) -> None:
    """Every finished stage knows itself what it depends on."""
    path, told = stopped(tmp_path / "run") / "fingerprint.json", []
    path.unlink() if content is None else path.write_text(content)
    with new_run(tmp_path / "run", THIS, resume=True, say=told.append) as folder:
        assert names(folder / STATE) == ["cluster.safetensors"]
        assert json.loads((folder / "fingerprint.json").read_text()) == THIS
    assert len(told) == 1 and "fingerprint.json cannot be read" in told[0]


@pytest.mark.parametrize("key", ["version", "state"])
def test_stages_of_another_release_are_made_anew(tmp_path: Path, key: str) -> None:
    told: list[str] = []
    stopped(tmp_path / "run")
    with new_run(tmp_path / "run", {**THIS, key: 9}, resume=True, say=told.append) as folder:
        assert names(folder / STATE) == []
    assert len(told) == 1 and "another release" in told[0]


@pytest.mark.parametrize("code", [errno.ENOSYS, errno.ENOLCK, errno.EOPNOTSUPP])
def test_a_file_system_without_locks_stops_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, code: int
) -> None:
    def flock(*_: object) -> None:
        raise OSError(code, os.strerror(code))

    monkeypatch.setattr("fcntl.flock", flock)
    told: list[str] = []
    with new_run(tmp_path / "run", THIS, say=told.append) as folder:
        (folder / "a").write_text("1")
    assert names(tmp_path / "run") == ["a"]
    assert len(told) == 1 and "file system without locks" in told[0]


@pytest.mark.parametrize("begun", [False, True])
def test_a_lock_that_fails_leaves_what_was_there(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, begun: bool
) -> None:
    def flock(*_: object) -> None:
        raise OSError(errno.EIO, os.strerror(errno.EIO))

    part = stopped(tmp_path / "run") if begun else None
    monkeypatch.setattr("fcntl.flock", flock)
    with (
        pytest.raises(OutputError, match="Input/output error"),
        new_run(tmp_path / "run", THIS, resume=True),
    ):
        pytest.fail("the body must not run")
    assert names(tmp_path) == ([] if part is None else [part.name])
    assert part is None or names(part / STATE) == ["cluster.safetensors"]
