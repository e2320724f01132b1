"""`spmm edit`: from a run to an edited run, and everything that it refuses."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image

from spmm_torch import SPMM
from spmm_torch.cli.main import main
from spmm_torch.edit import Script, intensity
from spmm_torch.edit.examples import packaged
from spmm_torch.report import REPORT_KEYS, check_report
from spmm_torch.runs.edited import EDITS, MASKS, ORIGINAL
from spmm_torch.runs.folder import CONFIG, REPORT_PAGE
from spmm_torch.runtime.tensor_file import MODEL_FILE
from tests.planted.models import FEW_RINGS, planted_model
from tests.planted.runs import model_folder


@pytest.fixture
def run(tmp_path: Path) -> Path:
    """A run folder as a fit leaves it."""
    folder = model_folder(tmp_path / "run", planted_model(rings=FEW_RINGS, residual=0.02))
    (folder / CONFIG).write_text("seed: 3\n")
    report = {key: dict.fromkeys(below, 1.0) if below else 7 for key, below in REPORT_KEYS.items()}
    pair = dict.fromkeys(("without_residual", "with_residual"), 1.0)
    report["display"] |= {"psnr_db": pair, "flip": pair}
    (folder / "report.json").write_text(json.dumps(report))
    return folder


def edit(*words: Path | str) -> int:
    return main(["edit", *map(str, words), "--device", "cpu"])


def test_an_edited_run_is_a_run(run: Path, tmp_path: Path) -> None:
    (tmp_path / "x.yaml").write_text("- intensity: {factor: 2}\n")
    assert edit(run, tmp_path / "x.yaml", "-o", tmp_path / "out") == 0
    out = tmp_path / "out"
    assert {path.name for path in out.iterdir()} == {
        MODEL_FILE,
        CONFIG,
        EDITS,
        ORIGINAL,
        "report.json",
        REPORT_PAGE,
    }
    expected = intensity(SPMM.load(run), 2.0)
    assert torch.equal(SPMM.load(out).weight, expected.weight)
    assert (out / CONFIG).read_text() == "seed: 3\n"
    page = (out / REPORT_PAGE).read_text(encoding="utf-8")
    assert "edited after its fit" in page
    assert "factor: 2.0" in page


def test_errors_of_the_fit_are_not_claimed(run: Path, tmp_path: Path) -> None:
    assert edit(run, "fig7", "-o", tmp_path / "out") == 0
    report = json.loads((tmp_path / "out" / "report.json").read_text())
    check_report(report)
    for key in ("psnr_db", "snr_db", "mssim", "sharpness", "seconds"):
        assert set(report[key].values()) == {None}
    unknown = {"without_residual": None, "with_residual": None}
    assert report["display"] == {"psnr_db": unknown, "flip": unknown, "slices": None}
    size = (tmp_path / "out" / MODEL_FILE).stat().st_size
    assert report["bytes"]["total"] == size
    assert report["total_basis"] == 12


def test_edits_of_edits_lead_from_the_fit(run: Path, tmp_path: Path) -> None:
    """edits.yaml holds all edits, and its masks lie in the folder."""
    mask = np.zeros((8, 8), dtype=np.uint8)
    mask[:, :4] = 255
    Image.fromarray(mask).save(tmp_path / "left.png")
    (tmp_path / "x.yaml").write_text(
        "- intensity: {factor: 2, mask: {picture: {path: left.png}}}\n"
    )
    assert edit(run, tmp_path / "x.yaml", "-o", tmp_path / "one") == 0
    (tmp_path / "left.png").unlink()
    assert edit(tmp_path / "one", "fig6.yaml", "-o", tmp_path / "two") == 0
    script = Script.read(tmp_path / "two" / EDITS)
    assert [step.name for step in script.steps] == ["intensity", "scale_width"]
    assert len(list((tmp_path / "two" / MASKS).iterdir())) == 1
    again = script.apply(SPMM.load(run))
    assert again.pack() == SPMM.load(tmp_path / "two").pack()


def test_a_model_file_alone(run: Path, tmp_path: Path) -> None:
    bare = tmp_path / "bare" / "x.safetensors"
    bare.parent.mkdir()
    bare.write_bytes((run / MODEL_FILE).read_bytes())
    assert edit(bare, "fig4_middle", "-o", tmp_path / "out") == 0
    assert {path.name for path in (tmp_path / "out").iterdir()} == {
        MODEL_FILE,
        EDITS,
        ORIGINAL,
        REPORT_PAGE,
    }


@pytest.mark.parametrize("name", packaged())
def test_every_example_runs(run: Path, tmp_path: Path, name: str) -> None:
    assert edit(run, name, "-o", tmp_path / "out") == 0
    before, after = SPMM.load(run), SPMM.load(tmp_path / "out")
    up = torch.tensor([0.0, 0.0, 1.0])
    assert not torch.allclose(before.picture(up, up), after.picture(up, up), rtol=1e-3)


@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        (["{run}", "fig66", "-o", "{tmp}/out"], "did you mean fig6"),
        (["{tmp}/none", "fig6", "-o", "{tmp}/out"], "does not exist"),
        (["{run}", "fig6", "-o", "{run}"], "exists; expected a new name"),
        (["{run}", "{tmp}/x.yaml", "-o", "{tmp}/out"], "unknown edit glow; valid: intensity"),
        (["{run}", "fig6"], "spmm edit --help tells"),
        (["{run}", "fig6", "--interactive"], "SCRIPT fig6 is given with --interactive"),
        (["{run}", "{run}/model.safetensors", "-o", "{tmp}/out"], "edit script {run}"),
    ],
)
def test_bad_input_is_one_sentence(
    run: Path,
    tmp_path: Path,
    refused: Callable[..., str],
    words: list[str],
    complaint: str,
) -> None:
    (tmp_path / "x.yaml").write_text("- glow: {}\n")
    expected = complaint.format(run=run)
    assert expected in refused("edit", *[word.format(run=run, tmp=tmp_path) for word in words])
    assert not (tmp_path / "out").exists()
    assert not list(tmp_path.glob(".*"))


def test_a_damaged_report(run: Path, tmp_path: Path, refused: Callable[..., str]) -> None:
    (run / "report.json").write_text("{")
    assert "restore or remove it" in refused("edit", run, "fig6", "-o", tmp_path / "out")
    assert not (tmp_path / "out").exists()
