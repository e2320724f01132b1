"""Every command that takes --device, on the simulated one: the same files as on the host."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from spmm_torch import SPMM
from spmm_torch.benchmark.launches.tally import Tally
from spmm_torch.cli.main import main
from spmm_torch.data.codecs import openexr
from spmm_torch.evaluate import planes, spheres
from spmm_torch.figures import FIGURES, sampling
from spmm_torch.render import RenderSettings
from tests.planted.btfs import rough_btf
from tests.planted.models import FEW_RINGS, planted_model, with_components, with_relief
from tests.planted.runs import make_run, model_folder, save

SMALL = ["--size", "10", "--samples", "1"]


@pytest.fixture(autouse=True)
def small_pictures(monkeypatch: pytest.MonkeyPatch) -> None:
    for module in (planes, spheres):
        monkeypatch.setattr(module, "SETTINGS", RenderSettings(size=24, samples=1))
    monkeypatch.setattr(sampling, "VARIANCE_HITS", 8)
    monkeypatch.setattr(sampling, "VARIANCE_SAMPLES", 16)
    monkeypatch.setattr(sampling, "OUR_SAMPLES", 4)


@pytest.fixture(scope="module")
def source(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return save(rough_btf(4), tmp_path_factory.mktemp("source") / "planted.npz")


@pytest.fixture(scope="module")
def run(source: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return make_run(source, tmp_path_factory.mktemp("runs") / "run")


@pytest.fixture
def drawn(tmp_path: Path) -> Path:
    """A run folder with nothing but a model, which has every part."""
    model = planted_model(5, rings=FEW_RINGS, residual=0.02)
    return model_folder(tmp_path / "drawn", with_relief(with_components(model, beside=True)))


def on_both(folder: Path, *words: str | Path) -> list[Path]:
    """What a command makes on the host and on the device."""
    places = [folder / f"host{words[-1]}", folder / f"device{words[-1]}"]
    for place, device in zip(places, ("cpu", "cuda"), strict=True):
        assert main([*map(str, words[:-1]), "-o", str(place), "--device", device]) == 0
    return places


def check_close(found: Any, expected: Any, ignored: frozenset[str]) -> None:
    """Figures of a report that agree, but for those of the machine."""
    if isinstance(expected, dict):
        assert found.keys() == expected.keys()
        for name in expected.keys() - ignored:
            check_close(found[name], expected[name], ignored)
    elif isinstance(expected, list):
        for pair in zip(found, expected, strict=True):
            check_close(*pair, ignored)
    elif isinstance(expected, float):
        assert found == pytest.approx(expected, rel=2e-3, abs=2e-3)
    else:
        assert found == expected


def test_fit(source: Path, tmp_path: Path, cuda: Tally) -> None:
    settings = ("--set=cluster.count=2", "--set=search.max_lobes=1", "--set=residual.rank=1")
    quick = (*settings, "--set=search.models=[lambertian]", "--set=search.bank_normals=8")
    host, device = on_both(tmp_path, "fit", source, *quick, "--no-render", "")
    expected, found = (
        json.loads((place / "report.json").read_text(encoding="utf-8")) for place in (host, device)
    )
    check_close(found["snr_db"], expected["snr_db"], frozenset())
    assert found["device"].startswith("cuda (simulated)") and expected["device"].startswith("cpu")


def test_evaluate(run: Path, tmp_path: Path, cuda: Tally) -> None:
    host, device = on_both(tmp_path, "evaluate", run, "")
    expected, found = (
        json.loads((place / "evaluation.json").read_text(encoding="utf-8"))
        for place in (host, device)
    )
    check_close(found, expected, frozenset({"device", "seconds", "versions"}))


@pytest.mark.parametrize("light", ["directional:30,45", "point:0,5,0"])
def test_render(light: str, drawn: Path, tmp_path: Path, cuda: Tally) -> None:
    host, device = on_both(tmp_path, "render", drawn, *SMALL, "--light", light, ".exr")
    expected, found = (openexr.decode(place.read_bytes()) for place in (host, device))
    assert expected.max() > 0.0
    assert np.isclose(found, expected, rtol=1e-3, atol=1e-3).mean() > 0.97  # rays that graze


def test_render_a_btf(source: Path, tmp_path: Path, cuda: Tally) -> None:
    words = ("render", "--input", source, *SMALL, "--light", "directional:30,45")
    host, device = on_both(tmp_path, *words, ".exr")
    expected, found = (openexr.decode(place.read_bytes()) for place in (host, device))
    assert np.isclose(found, expected, rtol=1e-3, atol=1e-3).mean() > 0.97  # rays that graze


@pytest.mark.parametrize("script", ["fig5_hue", "fig9"])
def test_edit(script: str, drawn: Path, tmp_path: Path, cuda: Tally) -> None:
    expected, found = (SPMM.load(place) for place in on_both(tmp_path, "edit", drawn, script, ""))
    for name, value in expected.state_dict().items():
        close = np.isclose(found.state_dict()[name], value, rtol=2e-3, atol=2e-3)
        assert close.mean() > 0.99, name  # a code may be rounded otherwise


@pytest.mark.slow
def test_figures(run: Path, tmp_path: Path, cuda: Tally) -> None:
    host, device = on_both(tmp_path, "figures", run, *SMALL, "")
    assert {path.name for path in device.iterdir()} == {path.name for path in host.iterdir()}
    assert {f"{name}.png" for name in FIGURES} < {path.name for path in device.iterdir()}
