"""`spmm fit` by the weights of a scene and of a file."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from safetensors.torch import load_file

from spmm_torch.cli.main import main
from tests.cli.test_resume import DIRECTIONS, OPTIONS, SIDE, rough, stopped
from tests.data.test_picture_set import make_files, write_zip

SCENE = "{shape: plane, camera: 'orthographic:20,0', lights: ['directional:40,0'], size: 32}"


@pytest.fixture(scope="module")
def source(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return rough(tmp_path_factory.mktemp("input") / "btf.npz", SIDE)


def test_other_weights_are_another_run(
    source: Path, tmp_path: Path, refused: Callable[..., str]
) -> None:
    """Even under the same name."""
    weights, run = tmp_path / "w.npz", tmp_path / "out" / "run"
    pair = np.random.default_rng(1).random((len(DIRECTIONS), len(DIRECTIONS)))
    np.savez(weights, pair=pair)
    stopped(source, run, 3, "--weights", str(weights))
    arguments = [str(source), "-o", str(run), *OPTIONS, "--weights", str(weights), "--resume"]
    np.savez(weights, pair=pair + 1.0)
    assert "has other content of" in refused("fit", *arguments)
    np.savez(weights, pair=pair)
    assert main(["fit", *arguments]) == 0
    report = json.loads((run / "report.json").read_text(encoding="utf-8"))
    assert report["weighted_snr_db"]["with_residual"] > 0.0


def test_a_scene_is_part_of_the_run(source: Path, tmp_path: Path) -> None:
    scene = tmp_path / "scene.yaml"
    scene.write_text(SCENE, encoding="utf-8")
    runs = {"plain": [], "scene": ["--scene", str(scene)]}
    for name, options in runs.items():
        assert main(["fit", str(source), "-o", str(tmp_path / name), *OPTIONS, *options]) == 0
    assert f"scene: {scene}" in (tmp_path / "scene" / "config.yaml").read_text(encoding="utf-8")
    plain, of_scene = (
        json.loads((tmp_path / name / "report.json").read_text(encoding="utf-8")) for name in runs
    )
    assert plain["weighted_snr_db"] is None
    assert of_scene["snr_db"]["without_residual"] < plain["snr_db"]["without_residual"]
    weighted = of_scene["weighted_snr_db"]
    assert weighted["with_residual"] > weighted["cluster_mean"]
    codes = [load_file(tmp_path / name / "model.safetensors") for name in runs]
    assert codes[0].keys() == codes[1].keys()


def test_missing_pairs_count_nowhere(tmp_path: Path) -> None:
    """Neither in the fit's report nor where the saved run is evaluated."""
    codes = np.random.default_rng(1).integers(100, 200, (3, 3, 4, 5, 3), dtype=np.uint8)
    files = make_files(codes)
    del files[5]
    source, run = write_zip(tmp_path / "btf.zip", files), tmp_path / "run"
    arguments = [str(source), "-o", str(run), *OPTIONS, "--set", "cluster.count=2"]
    assert main(["fit", *arguments]) == 2
    assert main(["fit", *arguments, "--set", "data.missing=mask"]) == 0
    assert main(["evaluate", str(run), "-o", str(tmp_path / "out"), "--device", "cpu"]) == 0
    report = json.loads((run / "report.json").read_text(encoding="utf-8"))
    found = json.loads((tmp_path / "out" / "evaluation.json").read_text(encoding="utf-8"))
    assert report["direction_pairs"] == found["direction_pairs"] == 8
    for group in ("snr_db", "psnr_db"):
        for name, value in report[group].items():
            assert found[group][name] == pytest.approx(value, abs=2e-3)
    assert found["held_out"] is None
