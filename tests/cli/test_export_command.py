"""`spmm export`: its targets, its options, and what it refuses."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import pytest

from spmm_torch.cli import export
from spmm_torch.cli.export import target_lines
from spmm_torch.cli.main import main
from spmm_torch.config.schema import setting
from spmm_torch.export import TARGETS, loss
from spmm_torch.render import RenderSettings
from tests.planted.models import planted_model
from tests.planted.runs import model_folder, newer_run


@pytest.fixture(autouse=True)
def quick_loss(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(loss, "QUERIES", 1 << 10)
    monkeypatch.setattr(loss, "SETTINGS", RenderSettings(size=24, samples=1))


def test_every_target_is_listed_with_what_it_leaves_out() -> None:
    text = "\n".join(target_lines())
    for target in TARGETS.values():
        assert f"\n{target.name:<9} {target.title}" in f"\n{text}"
    assert "holds lobes, residual, relief" in text


def test_a_run_is_exported(run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "x.exr"
    assert main(["export", str(run), "--to", "exr", "-o", str(out), "--device", "cpu"]) == 0
    *shown, last = capsys.readouterr().out.splitlines()
    assert last == str(out)
    assert shown[-1].startswith("SNR ")
    assert "random (uv, wi, wo)" in shown[-1]
    assert out.stat().st_size > 0


def damaged(folder: Path) -> Path:
    """A run whose model ends too soon."""
    run = model_folder(folder, planted_model(size=2, lobes_per_texel=1))
    file = run / "model.safetensors"
    file.write_bytes(file.read_bytes()[:-50])
    return run


def missing(folder: Path) -> Path:
    """A run that is not there."""
    return folder


BAD = [
    (newer_run, [], "has version 99; this program reads versions 1 and 2"),
    (damaged, [], "is damaged or no model"),
    (missing, [], "does not exist; expected a run folder"),
    (None, ["-o", "RUN"], "exists; expected a new name"),
    (None, ["-o", "x.png"], "does not fit --to exr; expected a name in .exr"),
    (None, ["-o", "nowhere/x.exr"], "is no folder"),
    (None, ["--to", "nothing"], "argument --to: invalid choice: 'nothing'"),
    (None, ["--device", "abacus"], "expected auto, cpu, cuda"),
]


@pytest.mark.parametrize(("make", "words", "complaint"), BAD)
def test_bad_input(
    run: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    refused: Callable[..., str],
    make: Callable[[Path], Path] | None,
    words: list[str],
    complaint: str,
) -> None:
    source = run if make is None else make(tmp_path / "bad")
    monkeypatch.chdir(tmp_path)
    before = sorted(tmp_path.rglob("*"))
    words = [str(run) if word == "RUN" else word for word in words]
    assert complaint in refused("export", source, "--to", "exr", "-o", tmp_path / "x.exr", *words)
    assert sorted(tmp_path.rglob("*")) == before


def test_an_option_of_another_target_is_refused(
    run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, refused: Callable[..., str]
) -> None:
    @dataclass(frozen=True)
    class Sized:
        size: int = setting(8, "texels", low=1)

    other = replace(TARGETS["exr"], name="other", settings=Sized)
    monkeypatch.setattr(export, "TARGETS", {**TARGETS, "other": other})
    words = ["export", run, "-o", tmp_path / "x.exr", "--size", "4"]
    assert "--size is an option of --to other; --to exr does not have it" in refused(
        *words, "--to", "exr"
    )
    assert "--size is 0; expected at least 1" in refused(*words, "--to", "other", "--size", "0")
