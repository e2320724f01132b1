"""A run outlives its terminal, and whoever reads what it says."""

from __future__ import annotations

import errno
import io
import os
import sys
from pathlib import Path

import numpy as np
import pytest

from spmm_torch.cli import cache, main
from spmm_torch.cli.main import BAD_INPUT, STOPPED
from spmm_torch.evaluate import open_source
from spmm_torch.geometry.directions import ring_directions

DIRECTIONS = ring_directions(((0.0, 1), (45.0, 4)))
OPTIONS = [
    "--config=smoke",
    "--no-render",
    "--device=cpu",
    "--set=cluster.count=1",
    "--set=search.models=lambertian",
    "--set=relief.mode=off",
    "--set=residual.rank=0",
]


class Lost(io.StringIO):
    """A stream of which somebody has read enough after one line, or that is full at once."""

    def __init__(self, code: int, lines: int = 0) -> None:
        super().__init__()
        self.code, self.lines = code, lines

    def write(self, text: str) -> int:
        if self.getvalue().count("\n") >= self.lines:
            raise OSError(self.code, os.strerror(self.code))
        return super().write(text)


def fit(folder: Path) -> int:
    values = np.random.default_rng(0).random((5, 5, 2, 2, 3)).astype(np.float32)
    np.savez(folder / "a.npz", values=values, view=DIRECTIONS, light=DIRECTIONS)
    return main.main(["fit", str(folder / "a.npz"), "-o", str(folder / "run"), *OPTIONS])


@pytest.mark.parametrize(
    "stream", [Lost(errno.EPIPE, 1), Lost(errno.ENOSPC), Lost(errno.EIO), None]
)
def test_a_fit_goes_on_without_standard_error(
    stream: io.StringIO | None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "stderr", stream)
    assert fit(tmp_path) == 0
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.npz", "run"]
    assert "load: done in" in (tmp_path / "run" / "log.txt").read_text()


@pytest.mark.parametrize(
    ("stream", "code"),
    [
        (Lost(errno.EPIPE), 0),
        (None, 0),
        (Lost(errno.ENOSPC), BAD_INPUT),
        (io.TextIOWrapper(io.BytesIO(), encoding="ascii"), 0),
    ],
)
def test_a_fit_is_whole_without_standard_output(
    stream: io.StringIO | None,
    code: int,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    folder = tmp_path / "M\u00fcnchen"
    folder.mkdir()
    monkeypatch.setattr(sys, "stdout", stream)
    assert fit(folder) == code
    assert (folder / "run" / "model.safetensors").exists()
    complaint = capsys.readouterr().err.splitlines()[-1]
    assert complaint.startswith("error: standard output cannot be written") == (code != 0)


def test_paths_that_are_no_utf_8(tmp_path: Path) -> None:
    """A run in such a folder is made, and then read."""
    folder = tmp_path / os.fsdecode(b"caf\xe9")
    try:
        folder.mkdir()
    except OSError:
        pytest.skip("this file system takes UTF-8 only")
    assert fit(folder) == 0
    (folder / "brighter.yaml").write_text("- intensity: {factor: 2}")
    words = ["edit", str(folder / "run"), str(folder / "brighter.yaml"), "-o", str(folder / "two")]
    assert main.main(words) == 0
    assert open_source(folder / "two", None).btf.path == str(folder / "a.npz")


@pytest.mark.parametrize(
    ("error", "complaint"),
    [
        (MemoryError(), "error: there is too little memory"),
        (RuntimeError("DefaultCPUAllocator: can't allocate memory"), "error: there is too little"),
        (RuntimeError("CUDA out of memory. Tried"), "error: there is too little memory"),
    ],
)
def test_too_little_memory_is_one_sentence(
    error: Exception,
    complaint: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    def run(_: object) -> list[str]:
        raise error

    monkeypatch.setattr(cache, "run", run)
    assert main.main(["cache", "list"]) == BAD_INPUT
    shown = capsys.readouterr().err
    assert shown.startswith(complaint) and shown.count("\n") == 1


@pytest.mark.parametrize("kind", [ImportError, SystemError, RecursionError])
def test_ctrl_c_that_an_import_turns_into_another_error(
    kind: type[Exception], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """C extensions and lazy modules raise an error of their own in place of it."""

    def run(_: object) -> list[str]:
        try:
            os.kill(os.getpid(), 2)
            raise AssertionError("the signal comes first")
        except KeyboardInterrupt as error:
            raise kind("initialization raised unreported exception") from error

    monkeypatch.setattr(cache, "run", run)
    assert main.main(["cache", "list"]) == STOPPED
    assert capsys.readouterr().err == "stopped.\n"


def test_another_error_is_a_bug(monkeypatch: pytest.MonkeyPatch) -> None:
    def run(_: object) -> list[str]:
        raise RuntimeError("bug")

    monkeypatch.setattr(cache, "run", run)
    with pytest.raises(RuntimeError, match="bug"):
        main.main(["cache", "list"])
