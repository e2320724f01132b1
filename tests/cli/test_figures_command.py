"""`spmm figures` on a run, and what it refuses."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from spmm_torch import SPMM
from spmm_torch.cli.main import main
from spmm_torch.edit.edits.residual_strength import residual_strength
from spmm_torch.figures import FIGURES, sampling
from tests.planted.btfs import rough_btf
from tests.planted.runs import make_run, save
from tests.report.test_page import Page

SMALL = ["--size", "16", "--samples", "1", "--device", "cpu"]


@pytest.fixture(autouse=True)
def few_samples(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sampling, "VARIANCE_HITS", 16)
    monkeypatch.setattr(sampling, "VARIANCE_SAMPLES", 32)
    monkeypatch.setattr(sampling, "OUR_SAMPLES", 4)


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("figures")
    return make_run(save(rough_btf(4), folder / "planted.npz"), folder / "run")


def test_all_figures(run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "out"
    assert main(["figures", str(run), "-o", str(out), *SMALL]) == 0
    assert capsys.readouterr().out == f"{out / 'figures.html'}\n"
    pictures = [f"{name}.png" for name in FIGURES]
    assert sorted(path.name for path in out.iterdir()) == sorted(
        [*pictures, "figures.html", "figures.json"]
    )
    for name in pictures:
        assert np.asarray(Image.open(out / name)).std() > 10.0
    values = json.loads((out / "figures.json").read_text(encoding="utf-8"))
    variance = values["figure10"]["variance"]
    assert set(variance) == {"sphere_studio", "sphere_white", "texel_white"}
    for found in variance.values():
        assert found["spmm"]["variance"] > 0.0
        ratio = found["cosine"]["variance"] / found["spmm"]["variance"]
        assert found["gain"]["equal_count"] == pytest.approx(ratio)
    assert len(values["figure3"]["exposure"]) == 3
    page = Page((out / "figures.html").read_text(encoding="utf-8"))
    assert len(page.images()) == len(FIGURES)
    assert any("equal sample count" in text for text in page.text)


def test_some_figures_need_no_input(run: Path, tmp_path: Path) -> None:
    report = run / "report.json"
    text = report.read_text(encoding="utf-8")
    report.unlink()
    try:
        words = ["--only", "figure10", "--texel", "1,2", "--view", "30,90"]
        assert main(["figures", str(run), "-o", str(tmp_path / "out"), *words, *SMALL]) == 0
    finally:
        report.write_text(text, encoding="utf-8")
    values = json.loads((tmp_path / "out" / "figures.json").read_text(encoding="utf-8"))
    assert values["figure10"]["texel"] == [1, 2]
    assert values["figure10"]["view_degrees"] == pytest.approx([30.0, 90.0])


def test_figures_of_the_lobes_alone(run: Path, tmp_path: Path) -> None:
    plain = tmp_path / "plain"
    shutil.copytree(run, plain)
    model = residual_strength(SPMM.load(run), 0.0)
    (plain / "model.safetensors").write_bytes(model.pack())
    for source, name, words in (
        (run, "lobes", ["--lobes-alone"]),
        (plain, "bare", []),
        (run, "whole", []),
    ):
        out = str(tmp_path / name)
        assert main(["figures", str(source), "-o", out, "--only", "figure5", *words, *SMALL]) == 0
    lobes, bare, whole = (
        (tmp_path / name / "figure5.png").read_bytes() for name in ("lobes", "bare", "whole")
    )
    assert lobes == bare != whole


def test_a_single_texel(tmp_path: Path) -> None:
    run = make_run(save(rough_btf(1), tmp_path / "one.npz"), tmp_path / "run")
    assert main(["figures", str(run), "-o", str(tmp_path / "out"), *SMALL]) == 0


@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        (["--only", "figure11"], "--only names 'figure11'; expected some of figure3"),
        (["--texel", "4,0"], "texel 4,0 lies outside"),
        (["--texel", "a"], "--texel: 'a' is no texel; expected X,Y"),
        (["--view", "45"], "--view: '45' is no view; expected THETA,PHI"),
        (["--view", "95,0"], "--view: '95,0' is no view; expected THETA from 0 to below 90"),
        (["--size", "0"], "size is 0"),
        (["--against", "none.zip"], "none.zip does not exist"),
        (["-o", "RUN"], "exists; expected a new name"),
    ],
)
def test_bad_input(
    run: Path,
    tmp_path: Path,
    refused: Callable[..., str],
    words: list[str],
    complaint: str,
) -> None:
    words = [str(run) if word == "RUN" else word for word in words]
    assert complaint in refused("figures", run, "-o", tmp_path / "out", *SMALL, *words)
    assert not list(tmp_path.iterdir())


def test_a_run_that_is_not_there(tmp_path: Path, refused: Callable[..., str]) -> None:
    assert "does not exist" in refused("figures", tmp_path / "none", "-o", tmp_path / "out")
