"""Scattered samples through the command line: fit, judged, rendered, edited; the rest refused."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from spmm_torch import SPMM
from spmm_torch.cli.main import main
from tests.planted.scattered import save_samples

QUICK = ("search.models=[lambertian,ward]", "search.max_lobes=2", "search.exchanges=0")


def fitted(folder: Path, **more: np.ndarray) -> tuple[Path, Path]:
    """Samples of two texels, and the run that was fit to them."""
    samples, run = save_samples(folder / "a.npz", 2, 150, **more), folder / "run"
    changes = [part for change in QUICK for part in ("--set", change)]
    assert main(["fit", str(samples), "-o", str(run), *changes]) == 0
    return samples, run


def test_a_run_serves_all_commands_that_need_no_grid(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    _, run = fitted(tmp_path)
    page = (run / "report.html").read_text(encoding="utf-8")
    assert "300 scattered samples (no grid, so neither a residual nor a relief)" in page
    assert (run / "log.txt").read_text(encoding="utf-8").count("neither a residual") == 1
    assert [row["name"] for row in json.loads((run / "report.json").read_text())["materials"]] == [
        "texel 0",
        "texel 1",
    ]
    others = save_samples(tmp_path / "b.npz", 2, 90)
    assert main(["evaluate", str(run)]) == 0
    own = json.loads((run / "evaluation.json").read_text())
    assert own["report_difference_db"] < 0.01
    assert main(["evaluate", str(run), "--against", str(others), "-o", str(tmp_path / "e")]) == 0
    assert (
        json.loads((tmp_path / "e" / "evaluation.json").read_text())["report_difference_db"] is None
    )
    assert "Worst direction pairs" in (tmp_path / "e" / "evaluation.html").read_text()
    size = ("--size", "16", "--samples", "1")
    assert main(["render", str(run), "-o", str(tmp_path / "a.png"), *size]) == 0
    script = tmp_path / "e.yaml"
    script.write_text("- intensity: {factor: 2.0}\n", encoding="utf-8")
    edited = main(["edit", str(run), str(script), "-o", str(tmp_path / "edited")])
    assert edited == 0, capsys.readouterr().err
    before, after = SPMM.load(run), SPMM.load(tmp_path / "edited")
    brightest = (model.weight.detach().max().item() for model in (after, before))
    assert next(brightest) / next(brightest) == pytest.approx(2.0, rel=1e-3)


def test_a_texture_has_a_page(tmp_path: Path) -> None:
    _, run = fitted(tmp_path, size=np.array([1, 2]))
    page = (run / "report.html").read_text(encoding="utf-8")
    assert "Texture slices" not in page
    assert main(["evaluate", str(run)]) == 0


def test_commands_that_need_a_grid_say_so(tmp_path: Path, refused: Callable[..., str]) -> None:
    samples = save_samples(tmp_path / "a.npz", 2, 150)
    words = "a.npz holds scattered samples, and"
    assert words in refused("check", samples)
    assert words in refused("convert", samples, "-o", tmp_path / "b.npz")
    run = tmp_path / "run"
    assert words in refused("fit", samples, "-o", run, "--set", "data.directions=2")
    assert not run.exists()
    assert "auto of the settings needs a grid" in refused("fit", samples, "-o", run, "--auto")
