"""`python -m spmm_torch.fit` on a corner of the bundled sample, and its run folder read back."""

from __future__ import annotations

import json
import math
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
import torch
from torch import Tensor

from spmm_torch import BTF, SPMM, FitConfig, load_btf
from spmm_torch.cli.fit import config_of
from spmm_torch.cli.main import main, parser
from spmm_torch.data import sample_path
from spmm_torch.data.crop import crop_ubo2003
from spmm_torch.report import check_report
from tests.locations import CONFIGS, ROOT

SMOKE = CONFIGS / "smoke.yaml"
SIZE = 8  # texels a side
FILES = ["config.yaml", "log.txt", "model.safetensors", "report.html", "report.json"]


@pytest.fixture(scope="module")
def sample(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A corner of the bundled sample, all 81 x 81 pairs."""
    path = tmp_path_factory.mktemp("sample") / "WEAVE8.zip"
    crop_ubo2003(sample_path(), 0, 0, SIZE, SIZE, path)
    return path


@pytest.fixture(scope="module")
def finished(
    sample: Path, tmp_path_factory: pytest.TempPathFactory
) -> tuple[Path, subprocess.CompletedProcess[str]]:
    """A run by a process of its own, and what that process said."""
    run = tmp_path_factory.mktemp("runs") / "run"
    command = [sys.executable, "-m", "spmm_torch.fit", str(sample), "-o", str(run)]
    process = subprocess.run(
        [*command, "--config", "configs/smoke.yaml", "--device", "cpu"],
        cwd=ROOT,
        env={**os.environ, "OMP_NUM_THREADS": "1"},
        capture_output=True,
        text=True,
        timeout=300,
    )
    assert process.returncode == 0, process.stderr
    return run, process


@pytest.fixture(scope="module")
def run(finished: tuple[Path, Any]) -> Path:
    return finished[0]


@pytest.fixture(scope="module")
def report(run: Path) -> dict[str, Any]:
    return json.loads((run / "report.json").read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def btf(sample: Path) -> BTF:
    return load_btf(sample).load()


@pytest.fixture(scope="module")
def model(run: Path) -> SPMM:
    return SPMM.load(run).requires_grad_(False)


def test_run_folder_is_complete(finished: tuple[Path, Any]) -> None:
    run, process = finished
    assert sorted(path.name for path in run.iterdir()) == FILES
    assert [path.name for path in run.parent.iterdir()] == ["run"]
    assert process.stdout.strip() == str(run / "report.html")
    assert "SNR" in process.stderr
    assert "SNR" in (run / "log.txt").read_text(encoding="utf-8")
    assert "\r" not in process.stderr  # plain lines where there is no terminal


def test_settings_are_kept(run: Path) -> None:
    expected = FitConfig.from_yaml(SMOKE).override(["device=cpu"])
    assert FitConfig.from_yaml(run / "config.yaml") == expected


def test_later_words_win() -> None:
    """First --config, then --set, then the options of single settings."""
    words = ["fit", "x.zip", "-o", "run", "--config", str(SMOKE), "--set", "cluster.count=5"]
    words += ["--seed", "4", "--set", "seed=3", "--crop", "1,2,3,4", "--directions", "2", "--auto"]
    config = config_of(parser().parse_args(words))
    assert (config.cluster.count, config.seed, config.auto) == (5, 4, True)
    assert (config.data.crop, config.data.directions) == ((1, 2, 3, 4), "2")
    assert config.select == FitConfig.from_yaml(SMOKE).select


def test_report(run: Path, report: dict[str, Any], sample: Path, btf: BTF, model: SPMM) -> None:
    check_report(report)
    assert report["input"] == str(sample)
    assert (report["texels"], report["direction_pairs"], report["channels"]) == (64, 6561, 3)
    assert report["clusters"] == model.cluster_count == 8
    assert report["raw_bytes"] == 64 * 6561 * 3
    assert report["bytes"]["total"] == (run / "model.safetensors").stat().st_size
    assert report["compression_ratio"] == pytest.approx(
        report["raw_bytes"] / report["bytes"]["total"]
    )
    assert report["total_basis"] == len(model.dictionary)
    counts = model.lobe_count_per_texel()
    assert report["mean_basis_per_texel"] == pytest.approx(float(counts.double().mean()))
    assert int(counts.max()) <= 4  # select.max_lobes of smoke.yaml
    assert sum(report["lobes_by_model"].values()) == int(counts.sum())
    assert report["psnr_peak"] == 1.0
    assert all(0.0 < value < 1.0 for value in report["mssim"].values())
    assert all(0.0 < value < 1.0 for value in report["sharpness"].values())
    psnr = report["display"]["psnr_db"]
    assert 0.0 < psnr["without_residual"] < psnr["with_residual"]
    assert (report["device"][:3], report["seed"]) == ("cpu", 0)
    seconds = report["seconds"]
    assert sum(seconds.values()) <= 2.0 * seconds["total"]  # the stages and the total itself
    energy = float(btf.texels().double().square().mean())
    for name, snr in report["psnr_db"].items():
        assert snr == pytest.approx(report["snr_db"][name] - 10 * math.log10(energy), abs=1e-3)


def expanded(model: SPMM, residual: bool, drift: Tensor | None = None) -> Tensor:
    """The model's values `[T, D, C]` at all measured pairs, straight from what is stored.

    Args:
        model: of a fit.
        residual: whether it has its residual.
        drift: registration of the pictures of the views, `[V, 2]`; None: 0.
    """
    atoms = model.dictionary.eval_grid(model.light, model.view)  # [J, D]
    texel = torch.repeat_interleave(model.lobe_count_per_texel())
    dense = torch.zeros(model.texel_count, len(atoms), 3)  # [T, J, C]
    dense.index_put_((texel, model.index), model.weight, accumulate=True)
    values = torch.einsum("jd,tjc->tdc", atoms, dense)
    if residual and len(model.residual.code):
        epsilon = model.residual.code.float() * model.residual.scale[:, None, None, None]
        values = values + epsilon.flatten(1, 2)[model.labels]
    if residual and model.components is not None:
        own = model.components
        functions = own.code.float() * own.scale[..., None, None]
        share = own.coefficient.float() * own.coefficient_scale
        values = values + torch.einsum("tr,rdc->tdc", share, functions.flatten(1, 2))
    if model.relief is None:
        return values
    seen = model.relief.field(model.height, model.width, model.view).footprint(model.view, drift)
    by_view = values.unflatten(1, (len(model.view), -1)).unbind(1)  # [T, L, C] each
    parts = zip(by_view, seen.texel, seen.weight, strict=True)
    pictures = [(value[texel] * weight[..., None, None]).sum(1) for value, texel, weight in parts]
    return torch.cat(pictures, dim=1)


def snr(values: Tensor, approximation: Tensor) -> float:
    error = (values.double() - approximation.double()).square().sum()
    return float(10.0 * torch.log10(values.double().square().sum() / error))


@pytest.mark.parametrize("residual", [False, True])
def test_reported_error_is_the_models(
    btf: BTF, model: SPMM, report: dict[str, Any], residual: bool
) -> None:
    """Over all texels, pairs and channels, without the algebra that the fit uses."""
    name = "with_residual" if residual else "without_residual"
    drift = None if model.relief is None else model.relief.drift
    found = snr(btf.texels(), expanded(model, residual, drift))
    assert report["snr_db"][name] == pytest.approx(found, abs=0.02)


@pytest.mark.parametrize("residual", [False, True])
def test_model_evaluates_at_measured_pairs(btf: BTF, model: SPMM, residual: bool) -> None:
    wi, wo = btf.pairs()
    whole = expanded(model, residual)
    for texel in (0, 29, 63):
        row, column = divmod(texel, SIZE)
        uv = torch.tensor([(column + 0.5) / SIZE, 1.0 - (row + 0.5) / SIZE])
        found = model(uv, wi, wo, residual=residual)
        torch.testing.assert_close(found, whole[texel], rtol=1e-3, atol=1e-4)


def test_cluster_mean(btf: BTF, model: SPMM, report: dict[str, Any]) -> None:
    values = btf.texels()
    means = torch.stack([values[model.labels == k].mean(0) for k in range(model.cluster_count)])
    found = snr(values, means[model.labels])
    assert report["snr_db"]["cluster_mean"] == pytest.approx(found, abs=0.02)
    assert report["snr_db"]["with_residual"] > found


def test_same_seed_same_bytes(
    sample: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    packed = []
    for name, seed in (("a", 0), ("b", 0), ("c", 1)):
        options = ["--config", str(SMOKE), "--device", "cpu", "--seed", str(seed), "--no-render"]
        assert main(["fit", str(sample), "-o", str(tmp_path / name), *options]) == 0
        packed.append((tmp_path / name / "model.safetensors").read_bytes())
    assert packed[0] == packed[1]
    assert packed[0] != packed[2]
    assert capsys.readouterr().out.splitlines()[0] == str(tmp_path / "a" / "report.html")
