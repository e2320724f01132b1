"""`spmm evaluate` on runs of every kind, and everything that it refuses."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import torch

from spmm_torch import SPMM, load_btf
from spmm_torch.cli.main import main
from spmm_torch.data import Selection
from spmm_torch.evaluate import spheres
from spmm_torch.metrics import snr_db
from spmm_torch.render import RenderSettings
from tests.planted.btfs import rough_btf
from tests.planted.runs import make_run, save
from tests.report.test_page import Page

FILES = ["evaluation.html", "evaluation.json"]


@pytest.fixture(autouse=True)
def small_pictures(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(spheres, "SETTINGS", RenderSettings(size=48, samples=1))


@pytest.fixture(scope="module")
def source(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return save(rough_btf(), tmp_path_factory.mktemp("source") / "planted.npz")


@pytest.fixture(scope="module")
def run(source: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return make_run(source, tmp_path_factory.mktemp("runs") / "run")


def evaluation(folder: Path) -> dict[str, Any]:
    return json.loads((folder / "evaluation.json").read_text(encoding="utf-8"))


def evaluated(run: Path, out: Path, *options: str) -> dict[str, Any]:
    """The figures of a run, which agree with those of its fit."""
    assert main(["evaluate", str(run), "-o", str(out), "--device", "cpu", *options]) == 0
    assert sorted(path.name for path in out.iterdir()) == FILES
    found = evaluation(out)
    report = json.loads((run / "report.json").read_text(encoding="utf-8"))
    for group in ("snr_db", "psnr_db"):
        known = {name: value for name, value in report[group].items() if value is not None}
        assert {name: found[group][name] for name in known} == pytest.approx(known, abs=2e-3)
    assert found["report_difference_db"] < 2e-3
    assert found["psnr_peak"] == pytest.approx(report["psnr_peak"])
    assert all(0.0 < value < 1.0 for value in found["mssim"].values())
    total = sum(sum(row) for row in found["by_angle"]["squared_error"])
    energy = sum(sum(row) for row in found["by_angle"]["energy"])
    assert snr_db(energy, total) == pytest.approx(found["snr_db"]["with_residual"], abs=1e-6)
    for rows in (found["worst_texels"], found["worst_pairs"]):
        shares = [row["error_share"] for row in rows]
        assert shares == sorted(shares, reverse=True)
        assert 0.0 < shares[-1] <= sum(shares) < 1.0 + 1e-9
    return found


def test_a_run_and_its_page(run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    found = evaluated(run, tmp_path / "out")
    assert capsys.readouterr().out == f"{tmp_path / 'out' / 'evaluation.html'}\n"
    assert found["held_out"] is None
    assert "--directions" in found["held_out_note"]
    assert (found["texels"], found["direction_pairs"]) == (36, 400)
    page = Page((tmp_path / "out" / "evaluation.html").read_text(encoding="utf-8"))
    names = {name for name, _ in page.elements}
    assert not names & {"script", "link", "iframe", "object"}
    images = page.images()
    assert len(images) == 3 * 3 + 1 + 3 * 4  # spheres, map of texels, worst pairs
    assert images["Map of the error of each texel"].shape == (6, 6, 3)
    assert f"{found['mssim']['mean']:.3f}" in page.text
    assert f"{100.0 * found['sharpness']['from_above']:.0f} %" in page.text
    assert f"{found['display']['psnr_db']['with_residual']:.2f} dB" in page.text


def test_the_worst_pair_is_the_worst(run: Path, source: Path, tmp_path: Path) -> None:
    found = evaluated(run, tmp_path / "out")
    model, btf = SPMM.load(run), load_btf(source)
    worst = found["worst_pairs"][0]
    errors = {}
    for view, wo in enumerate(btf.view):
        for light, wi in enumerate(btf.light):
            difference = model.picture(wi, wo).detach() - btf.picture(view, light)
            errors[view, light] = float(difference.square().sum())
    view, light = max(errors, key=errors.__getitem__)
    for name, direction in (("view", btf.view[view]), ("light", btf.light[light])):
        polar = float(torch.rad2deg(torch.arccos(direction[2].clamp(max=1.0))))
        assert worst[name]["polar"] == pytest.approx(polar, abs=0.1)
    share = errors[view, light] / sum(errors.values())
    assert worst["error_share"] == pytest.approx(share, rel=1e-3)


def test_it_writes_into_the_run_and_again(run: Path, tmp_path: Path) -> None:
    copy = tmp_path / "run"
    shutil.copytree(run, copy)
    before = {path.name for path in copy.iterdir()}
    for _ in range(2):
        assert main(["evaluate", str(copy), "--device", "cpu"]) == 0
        assert {path.name for path in copy.iterdir()} == before | set(FILES)
    assert evaluation(copy)["run"] == str(copy)


def test_held_out_directions(source: Path, tmp_path: Path) -> None:
    run = make_run(source, tmp_path / "run", "--directions", "2")
    found = evaluated(run, tmp_path / "out")
    model, btf = SPMM.load(run).requires_grad_(False), load_btf(source)
    part = load_btf(source, selection=Selection(directions="2"))
    assert found["direction_pairs"] == part.pair_count == 49
    held_out = found["held_out"]
    assert held_out["direction_pairs"] == btf.pair_count - part.pair_count
    seen = {tuple(direction) for direction in part.view.tolist()}
    energy = error = 0.0
    for view, wo in enumerate(btf.view):
        for light, wi in enumerate(btf.light):
            if tuple(wo.tolist()) in seen and tuple(wi.tolist()) in seen:
                continue
            value = btf.picture(view, light)
            energy += float(value.square().sum())
            error += float((model.picture(wi, wo) - value).square().sum())
    assert held_out["snr_db"]["with_residual"] == pytest.approx(snr_db(energy, error), abs=1e-3)
    assert held_out["snr_db"]["with_residual"] < found["snr_db"]["with_residual"]
    assert found["held_out_note"] is None
    rows = held_out["by_angle"]["squared_error"]
    assert sum(sum(row) for row in rows) == pytest.approx(error, rel=1e-3)
    page = Page((tmp_path / "out" / "evaluation.html").read_text(encoding="utf-8"))
    assert "SNR in dB, held out" in page.text


def test_hdr_crop_and_single_texel(source: Path, tmp_path: Path) -> None:
    hdr = save(rough_btf(scale=3.0), tmp_path / "hdr.npz")
    run = make_run(hdr, tmp_path / "hdr", "--directions", "2")
    found = evaluated(run, tmp_path / "out1")
    assert found["psnr_peak"] != 1.0
    assert found["held_out"] is not None
    run = make_run(source, tmp_path / "crop", "--crop", "1,2,4,3")
    assert evaluated(run, tmp_path / "out2")["texels"] == 12
    single = save(rough_btf(1), tmp_path / "single.npz")
    found = evaluated(make_run(single, tmp_path / "one"), tmp_path / "out3")
    assert found["worst_texels"][0]["error_share"] == 1.0


def test_an_input_that_was_moved(run: Path, source: Path, tmp_path: Path) -> None:
    moved = tmp_path / "elsewhere.npz"
    shutil.copy(source, moved)
    found = evaluated(run, tmp_path / "out", "--against", str(moved))
    assert found["input"] == str(moved)


def test_another_input_is_told(
    run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    other = save(rough_btf(seed=8), tmp_path / "other.npz")
    assert main(["evaluate", str(run), "-o", str(tmp_path / "out"), "--against", str(other)]) == 0
    assert "warning: these differ from report.json" in capsys.readouterr().err
    assert evaluation(tmp_path / "out")["report_difference_db"] > 0.01


@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        (["none"], "does not exist"),
        (["RUN", "--against", "none.zip"], "none.zip does not exist"),
        (["RUN", "--against", "LARGER"], "has 7 x 7 texels"),
        (["RUN", "--against", "COARSER"], "has 7 of the 20 view directions"),
        (["RUN", "-o", "RUN"], "exists; expected a new name"),
        (["RUN", "--device", "abacus"], "expected auto, cpu, cuda"),
        (["MOVED"], "give its present path with --against"),
        (["BARE"], "report.json cannot be read"),
        (["RUN", "--what"], "unrecognized arguments: --what; spmm evaluate --help tells"),
        ([], "the following arguments are required: RUN"),
    ],
)
def test_bad_input(
    run: Path,
    tmp_path: Path,
    refused: Callable[..., str],
    words: list[str],
    complaint: str,
) -> None:
    places = {"RUN": run, "LARGER": tmp_path / "larger.npz", "COARSER": tmp_path / "coarser.npz"}
    places |= {"MOVED": tmp_path / "moved", "BARE": tmp_path / "bare"}
    save(rough_btf(7), places["LARGER"])
    whole = rough_btf()
    save(whole.restricted(views=torch.arange(7), lights=torch.arange(20)), places["COARSER"])
    shutil.copytree(run, places["MOVED"])
    report = json.loads((run / "report.json").read_text()) | {"input": "gone.npz"}
    (places["MOVED"] / "report.json").write_text(json.dumps(report))
    places["BARE"].mkdir()
    shutil.copy(run / "model.safetensors", places["BARE"])
    before = sorted(run.iterdir())
    assert complaint in refused("evaluate", *(places.get(word, word) for word in words))
    assert sorted(run.iterdir()) == before
    assert not list(tmp_path.glob("*/*.html.*"))
