"""`spmm synthesize` from maps to files, and everything that it refuses."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image

from spmm_torch.cli.main import NOTHING_WRITTEN, STOPPED, main
from spmm_torch.data import load_btf
from spmm_torch.geometry.directions import ring_directions
from spmm_torch.runtime.progress import Progress
from spmm_torch.synthesize import SynthesisSettings, pipeline, variant
from spmm_torch.synthesize.maps import TextureMaps
from spmm_torch.synthesize.tracer import PathTracer

FEW_RINGS = ((0.0, 1), (60.0, 4))
SET, FEW = 81, 5
needs_mitsuba = pytest.mark.skipif(
    variant.find_spec("mitsuba") is None,
    reason="needs Mitsuba: pip install 'spmm_torch[mitsuba]'",
)


@pytest.fixture(autouse=True)
def few_directions(monkeypatch: pytest.MonkeyPatch) -> None:
    """The set of 81 directions has 5 here."""
    monkeypatch.setitem(pipeline.RINGS, SET, FEW_RINGS)


@pytest.fixture
def arguments(tmp_path: Path) -> list[str]:
    """A texture of 4 x 8 texels, and settings that take a moment."""
    generator = np.random.default_rng(0)
    (tmp_path / "maps").mkdir()
    given = ["--size", "8", "--directions", str(SET), "--samples", "4"]
    given += ["--variant", variant.PLAIN, "--threads", "1"]
    for role, channels in (("height", ()), ("albedo", (3,)), ("roughness", ())):
        codes = generator.integers(40, 256, (8, 16, *channels), np.uint8)
        Image.fromarray(codes).save(tmp_path / "maps" / f"{role}.png")
        given += [f"--{role}", str(tmp_path / "maps" / f"{role}.png")]
    return given


def left(folder: Path) -> set[str]:
    """What lies in a folder beside the maps."""
    return {path.name for path in folder.iterdir()} - {"maps"}


@needs_mitsuba
@pytest.mark.parametrize("name", ["x.npz", "x"])
def test_hdr_targets_hold_the_radiance(arguments: list[str], tmp_path: Path, name: str) -> None:
    assert main(["synthesize", *arguments, "-o", str(tmp_path / name)]) == 0
    assert left(tmp_path) == {name}
    if name == "x":
        assert len(list((tmp_path / name).rglob("*.exr"))) == FEW**2
        return
    btf = load_btf(tmp_path / name)
    assert (btf.height, btf.width, btf.pair_count) == (4, 8, FEW**2)
    torch.testing.assert_close(btf.view, ring_directions(FEW_RINGS))
    torch.testing.assert_close(btf.light, btf.view)
    values = btf.texels()
    assert 0.01 < float(values.mean()) < 1.0 / np.pi


@needs_mitsuba
def test_a_zip_is_scaled_to_its_percentile_and_tells_what_was_clipped(
    arguments: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["synthesize", *arguments, "-o", str(tmp_path / "x.npz")]) == 0
    assert main(["synthesize", *arguments, "-o", str(tmp_path / "x.zip"), "--gamma", "1.8"]) == 0
    radiance = load_btf(tmp_path / "x.npz").texels()
    scale = float(radiance.flatten().quantile(0.998, interpolation="higher"))
    codes = load_btf(tmp_path / "x.zip", gamma=1.8).texels()
    assert float((codes - (radiance / scale).clamp(max=1.0)).abs().mean()) < 0.02  # JPEG
    clipped = int((radiance > scale).sum())
    text = capsys.readouterr().err
    assert "scale: 1 stands for" in text
    assert f"{clipped} of {radiance.numel()} values" in text


@needs_mitsuba
def test_the_same_seed_gives_the_same_bytes(arguments: list[str], tmp_path: Path) -> None:
    for name, seed in (("a", "3"), ("b", "3"), ("c", "4")):
        (tmp_path / name).mkdir()
        output = tmp_path / name / "x.zip"
        assert main(["synthesize", *arguments, "--seed", seed, "-o", str(output)]) == 0
    first, second, third = ((tmp_path / name / "x.zip").read_bytes() for name in "abc")
    assert first == second
    assert first != third


@needs_mitsuba
def test_a_stop_leaves_nothing(
    arguments: list[str],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    picture = PathTracer.picture
    seen = []

    def stop_at_the_third(self: PathTracer, *given: object) -> np.ndarray:
        seen.append(left(tmp_path))
        if len(seen) == 3:
            raise KeyboardInterrupt
        return picture(self, *given)

    monkeypatch.setattr(PathTracer, "picture", stop_at_the_third)
    assert main(["synthesize", *arguments, "-o", str(tmp_path / "x.npz")]) == STOPPED
    assert capsys.readouterr().err.splitlines()[-1] == NOTHING_WRITTEN
    assert seen[0] != set()  # the hidden folder that must be gone
    assert left(tmp_path) == set()


@needs_mitsuba
def test_a_texture_that_reflects_nothing_is_refused(
    arguments: list[str], tmp_path: Path, refused: Callable[..., str]
) -> None:
    Image.new("RGB", (16, 8)).save(tmp_path / "maps" / "albedo.png")
    assert "is all black" in refused(
        "synthesize", *arguments, "--specular", "0", "-o", tmp_path / "x.zip"
    )
    assert left(tmp_path) == set()


BAD_SETTINGS = {
    "relief": ("-0.1", "--relief is -0.1; expected 0.0 to 0.5"),
    "size": ("0", "--size is 0; expected at least 1"),
    "directions": ("80", "invalid choice: 80 (choose from"),
    "samples": ("0", "--samples"),
    "bounces": ("0", "--bounces"),
    "specular": ("1.5", "--specular"),
    "gamma": ("0", "--gamma is 0.0; expected 0.01 to 10.0"),
    "seed": ("-1", "--seed"),
    "threads": ("-2", "--threads"),
    "scale": ("peak", "invalid choice: 'peak'"),
    "variant": ("gpu", "invalid choice: 'gpu'"),
    "height": ("no.png", "height map no.png does not exist"),
    "albedo": ("no.png", "albedo map no.png does not exist"),
}


@pytest.mark.parametrize("name", BAD_SETTINGS)
def test_bad_settings_end_in_one_sentence(
    arguments: list[str], tmp_path: Path, refused: Callable[..., str], name: str
) -> None:
    value, complaint = BAD_SETTINGS[name]
    words = [f"--{name}", value, "-o", tmp_path / "x.zip"]
    assert complaint in refused("synthesize", *arguments, *words)
    assert left(tmp_path) == set()


@pytest.mark.parametrize(
    ("output", "complaint"),
    [
        ("maps", "maps exists; expected a new name"),
        ("no/x.zip", "no of"),
        ("x.btf", "x.btf has an unknown ending; expected a new name that ends in .zip"),
    ],
)
def test_bad_outputs_end_in_one_sentence(
    arguments: list[str],
    tmp_path: Path,
    refused: Callable[..., str],
    output: str,
    complaint: str,
) -> None:
    assert complaint in refused("synthesize", *arguments, "-o", tmp_path / output)
    assert left(tmp_path) == set()


def test_a_small_disk_is_refused_before_rendering(
    arguments: list[str],
    tmp_path: Path,
    refused: Callable[..., str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    usage = shutil.disk_usage(tmp_path)._replace(free=1000)
    monkeypatch.setattr(shutil, "disk_usage", lambda path: usage)
    assert "GB of disk but" in refused("synthesize", *arguments, "-o", tmp_path / "x.npz")
    assert left(tmp_path) == set()


def test_without_mitsuba_nothing_is_left(
    arguments: list[str],
    tmp_path: Path,
    refused: Callable[..., str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(variant, "find_spec", lambda name: None)
    assert "pip install 'spmm_torch[mitsuba]'" in refused(
        "synthesize", *arguments, "-o", tmp_path / "x.npz"
    )
    assert left(tmp_path) == set()


def test_the_help_names_every_setting(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as stop:
        main(["synthesize", "--help"])
    assert stop.value.code == 0
    text = capsys.readouterr().out
    assert all(f"--{name}" in text for name in SynthesisSettings.__dataclass_fields__)


def test_values_above_1_are_clipped_and_counted() -> None:
    pictures = np.linspace(0.0, 2.0, 1000, dtype=np.float32).reshape(1, 1, 10, 100, 1)
    scale = pipeline.display_scale(pictures)
    assert scale == pytest.approx(np.sort(pictures.ravel())[997])
    line = pipeline.to_display(pictures, scale)
    assert "; 2 of 1000 values (0.2 %)" in line
    assert pictures.max() == 1.0


@needs_mitsuba
def test_a_normal_map_upside_down_is_told(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rows = np.linspace(0.0, 2.0 * np.pi, 8, endpoint=False)
    height = np.repeat((0.5 + 0.5 * np.sin(rows))[:, None], 8, axis=1).astype(np.float32)
    tilt = np.repeat(-np.cos(rows)[:, None], 8, axis=1)  # the sign of DirectX
    normal = np.stack((np.zeros_like(tilt), tilt, np.ones_like(tilt)), axis=-1) / np.sqrt(2.0)
    maps = TextureMaps(height, np.ones((8, 8, 3), np.float32), height, normal=normal)
    few = SynthesisSettings(size=2, directions=SET, samples=1, variant=variant.PLAIN, threads=1)
    pipeline.synthesize_btf(maps, tmp_path / "x.npz", few, Progress())
    assert "invert its green channel" in capsys.readouterr().err
