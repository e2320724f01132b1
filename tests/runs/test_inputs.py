"""The input of a run is read again as its fit read it, by everything that reads it."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import torch

from spmm_torch import BTF, FitConfig
from spmm_torch.cli.main import main
from spmm_torch.config.fit import DataConfig
from spmm_torch.data import load_input
from spmm_torch.data.codecs import openexr
from spmm_torch.data.ubo2014 import write_ubo2014
from spmm_torch.errors import ConfigError, DataError, OutputError
from spmm_torch.evaluate import open_source
from spmm_torch.geometry.directions import direction_from_angles
from spmm_torch.model.spmm import SPMM
from spmm_torch.render import BTFMaterial
from spmm_torch.runs.inputs import check_finished, has_input, own_input, read_input
from spmm_torch.viz.measured import measured_input, measured_samples
from tests.data.test_picture_set import GRID, make_files, write_zip
from tests.planted.models import planted_model
from tests.planted.runs import model_folder

SETTINGS = {
    "gamma": {"gamma": 1.0},
    "cosine": {"cosine": "missing"},
    "missing": {"missing": "mask"},
    "crop": {"crop": [1, 0, 3, 2]},
    "negative": {"negative": "clip"},
    "texels": {"texels": 6},
    "all": {"gamma": 1.0, "missing": "mask", "crop": [1, 1, 2, 2], "cosine": "missing"},
}


@pytest.fixture(params=SETTINGS)
def made(request: pytest.FixtureRequest, tmp_path: Path) -> tuple[Path, BTF]:
    """A run folder of these settings, and its input as the fit read it."""
    settings = FitConfig.from_dict({"data": SETTINGS[request.param], "seed": 3})
    codes = np.random.default_rng(1).integers(1, 256, (3, 3, 4, 5, 3), dtype=np.uint8)
    files = make_files(codes)
    if settings.data.missing == "mask":
        del files[8]
    source = write_zip(tmp_path / "a.zip", files)
    if settings.data.negative == "clip":
        view = direction_from_angles(*torch.deg2rad(torch.tensor(GRID).float()).T)
        values = codes.astype(np.float32) / 255.0 - 0.5
        source = tmp_path / "a.npz"
        np.savez(source, values=values, view=view.numpy(), light=view.numpy())
    btf = load_input(source, settings.data, settings.seed)
    return run_of(btf, settings, tmp_path / "run"), btf


def run_of(btf: BTF, settings: FitConfig, folder: Path) -> Path:
    """A run folder whose model has the texels and directions of a BTF, and other values."""
    tensors, metadata = planted_model(5).to_tensors()
    count = btf.texel_count
    tensors |= {name: tensors[name][:count] for name in ("weights.count", "weights.label")}
    entries = int(tensors["weights.count"].sum())
    tensors |= {name: tensors[name][:entries] for name in ("weights.index", "weights.weight")}
    tensors |= {"directions.light": btf.light, "directions.view": btf.view}
    clusters = len(tensors["residual.code"])
    tensors["residual.code"] = torch.zeros(clusters, len(btf.view), len(btf.light), 3).half()
    size = {"height": str(btf.height), "width": str(btf.width)}
    model_folder(folder, SPMM.from_tensors(tensors, metadata | size))
    (folder / "config.yaml").write_text(settings.to_yaml())
    (folder / "report.json").write_text(json.dumps({"input": btf.path}))
    return folder


def same(one: BTF | None, other: BTF) -> bool:
    assert one is not None
    gaps = one.missing is None if other.missing is None else torch.equal(one.missing, other.missing)
    return gaps and torch.equal(one.texels(), other.texels())


def test_all_read_the_input_as_the_fit_did(made: tuple[Path, BTF]) -> None:
    run, btf = made
    assert same(read_input(run), btf)
    assert same(read_input(run / "model.safetensors"), btf)
    assert same(read_input(run, btf.path), btf)
    assert same(measured_input(run, None), btf)
    assert same(open_source(run, None).btf, btf)


def test_samples_of_a_texel_are_those_that_were_measured(made: tuple[Path, BTF]) -> None:
    run, btf = made
    view = 2  # that whose last light has no picture under data.missing=mask
    samples = measured_samples(read_input(run), SPMM.load(run), 1, btf.view[view])
    pictures = torch.ones(3, 3, dtype=torch.bool) if btf.missing is None else ~btf.missing
    assert torch.equal(samples.wi, btf.light[pictures[view]])
    values = btf.texels()[1].view(3, 3, 3)[view][pictures[view]]
    assert torch.equal(samples.value, values)


def test_render_reads_the_input_as_the_run_did(made: tuple[Path, BTF], tmp_path: Path) -> None:
    run, btf = made
    words = ["--input", btf.path, "--shape", "plane", "--size", "8", "--samples", "4"]
    words += ["--light", "directional:20,0", "--device", "cpu", "-o"]
    assert main(["render", str(run), *words, str(tmp_path / "run.exr")]) == 0
    settings = ["--config", str(run / "config.yaml")]
    assert main(["render", *settings, *words, str(tmp_path / "set.exr")]) == 0
    pictures = [openexr.decode((tmp_path / name).read_bytes()) for name in ("run.exr", "set.exr")]
    assert np.array_equal(*pictures)
    uv = torch.rand(4096, 2, generator=torch.Generator().manual_seed(0))
    wi = direction_from_angles(torch.deg2rad(torch.tensor(20.0)), torch.tensor(0.0))
    mean = BTFMaterial.build(btf)(uv, wi, torch.tensor([0.0, 0.0, 1.0])).mean()
    seen = pictures[0][pictures[0].sum(2) > 0.0].mean()
    assert seen == pytest.approx(float(mean), rel=0.35)


@pytest.mark.parametrize("stated", [None, "top", "bottom"])
def test_runs_of_earlier_releases_read_their_btf_as_they_did(
    tmp_path: Path, stated: str | None
) -> None:
    """They state no order of rows, as the bottom row was always taken to come first."""
    codes = np.random.default_rng(1).integers(1, 256, (3, 3, 4, 5, 3), dtype=np.uint8)
    values = load_input(write_zip(tmp_path / "a.zip", make_files(codes)), DataConfig())
    write_ubo2014(tmp_path / "a.btf", values)
    content = (tmp_path / "a.btf").read_bytes()
    (tmp_path / "a.btf").write_bytes(content.replace(b"<?spmm rows=", b"<?none rows="))
    settings = FitConfig.from_dict({"data": {"rows": stated or "bottom"}})
    btf = load_input(tmp_path / "a.btf", settings.data)
    run = run_of(btf, settings, tmp_path / "run")
    if stated is None:
        text = settings.to_yaml()
        assert "  rows: bottom\n" in text
        (run / "config.yaml").write_text(text.replace("  rows: bottom\n", ""))
    assert same(read_input(run), btf)


@pytest.mark.parametrize("name", ["a.zip", "a.btf"])
def test_the_order_of_rows_is_that_of_a_btf_file_alone(tmp_path: Path, name: str) -> None:
    """Runs of earlier releases state none, and `--resume` refused them for any format."""
    run = model_folder(tmp_path / "run", planted_model())
    text = FitConfig().to_yaml()
    assert "  rows: top\n" in text
    (run / "config.yaml").write_text(text.replace("  rows: top\n", ""))
    (run / "report.json").write_text(json.dumps({"input": name}))
    if name == "a.zip":
        check_finished(run, name, FitConfig())
        with pytest.raises(ConfigError, match=r"seed"):
            check_finished(run, name, FitConfig(seed=5))
    else:
        with pytest.raises(ConfigError, match=r"rows = 'bottom', not 'top'"):
            check_finished(run, name, FitConfig())


def test_what_a_run_does_not_say(tmp_path: Path) -> None:
    """A model alone has no input; a run without its settings must not be guessed at."""
    run = model_folder(tmp_path / "run", planted_model())
    assert not has_input(run)
    with pytest.raises(OutputError, match="names no input; expected a fit"):
        read_input(run)
    (run / "report.json").write_text('{"input": 5}')
    with pytest.raises(OutputError, match="names no input; expected the report of a run"):
        read_input(run)
    (run / "report.json").write_text('{"input": "a.zip"}')
    with pytest.raises(ConfigError, match=r"config\.yaml cannot be read"):
        read_input(run, "a.zip")


@pytest.fixture
def relative(tmp_path: Path) -> Path:
    """A run as earlier releases made it in `work`, by `spmm fit in/a.npz -o runs/one`."""
    work = tmp_path / "work"
    for folder in ("in", "runs"):
        (work / folder).mkdir(parents=True)
    view = np.float32([[0.0, 0.0, 1.0], [0.6, 0.0, 0.8]])
    source = work / "in" / "a.npz"
    np.savez(source, values=np.ones((2, 2, 2, 2, 3), np.float32), view=view, light=view)
    run = model_folder(work / "runs" / "one", planted_model(3))
    (run / "config.yaml").write_text(FitConfig().to_yaml())
    (run / "report.json").write_text(json.dumps({"input": "in/a.npz"}))
    return run


def test_a_relative_input_is_found_from_everywhere(
    relative: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    source = tmp_path / "work" / "in" / "a.npz"
    for here in (tmp_path / "work", relative, tmp_path):
        monkeypatch.chdir(here)
        assert own_input(relative) == own_input(relative / "model.safetensors") == source
        assert has_input(relative)
        assert read_input(relative).texel_count == 4
    monkeypatch.chdir(tmp_path / "work" / "runs")
    assert read_input("one").texel_count == 4


def test_a_run_that_was_moved_is_read_from_where_the_command_is_called(
    relative: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    moved = relative.rename(tmp_path / "moved")
    assert not has_input(moved)
    with pytest.raises(DataError, match=f"a.npz, does not exist in {tmp_path}, .*--against"):
        read_input(moved)
    monkeypatch.chdir(tmp_path / "work")
    assert read_input(moved).texel_count == 4


def test_an_edited_model_names_no_input(relative: Path) -> None:
    (relative / "report.json").write_text(json.dumps({"input": ""}))
    assert not has_input(relative)
    with pytest.raises(OutputError, match="names no input; .*--against"):
        read_input(relative)
