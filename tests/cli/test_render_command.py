"""`spmm render` from a run to pictures, and everything that it refuses."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image

from spmm_torch.cli.main import main
from spmm_torch.data import sample_path
from spmm_torch.data.codecs import openexr

SMALL = ["--size", "12", "--samples", "1", "--device", "cpu"]
SUN = ["--light", "directional:30,45"]


def read_exr(path: Path) -> np.ndarray:
    return openexr.decode(path.read_bytes())


def test_png_and_exr_of_a_run(
    run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    png, exr = tmp_path / "x.png", tmp_path / "x.exr"
    assert main(["render", str(run), "-o", str(png), *SMALL, *SUN]) == 0
    shown = capsys.readouterr().out
    assert shown.startswith(f"{png} (exposure ")
    assert main(["render", str(run), "-o", str(exr), *SMALL, *SUN]) == 0
    assert capsys.readouterr().out == f"{exr}\n"
    picture = read_exr(exr)
    assert picture.shape == (12, 12, 3)
    factor = float(shown.split()[-1].rstrip(")"))
    codes = np.asarray(Image.open(png))
    top = np.clip(picture * factor, 0.0, 1.0)
    curve = np.where(top <= 0.0031308, 12.92 * top, 1.055 * top ** (1 / 2.4) - 0.055)
    assert np.abs(curve * 255.0 - codes).max() < 1.0


def test_the_light_is_where_it_is_said_to_be(run: Path, tmp_path: Path) -> None:
    shares = []
    for light in ("directional:60,0", "directional:60,180,2,2,2", "point:0,5,0"):
        out = tmp_path / "x.exr"
        assert main(["render", str(run), "-o", str(out), "--light", light, *SMALL]) == 0
        picture = read_exr(out)
        shares.append((picture[:, 6:].sum() / picture.sum(), picture[:6].sum() / picture.sum()))
    assert shares[0][0] > 0.6
    assert shares[1][0] < 0.4
    assert shares[2][1] > 0.9


def test_a_raw_btf(tmp_path: Path) -> None:
    out = tmp_path / "x.exr"
    words = ["--input", str(sample_path()), "--shape", "plane", "--cache", str(tmp_path / "c")]
    words += ["--camera", "perspective:40,270,3,50", "--repeat", "1"]
    assert main(["render", *words, "-o", str(out), *SMALL, *SUN]) == 0
    assert 0.0 < read_exr(out).max() < 2.0
    assert list((tmp_path / "c").glob("*.npy"))


@pytest.mark.parametrize("what", ["light", "camera"])
def test_turntables(run: Path, tmp_path: Path, what: str) -> None:
    out = tmp_path / "x.gif"
    words = [str(run), "-o", str(out), "--turntable", "3", "--turn", what]
    assert main(["render", *words, "--camera", "perspective:60,20", *SMALL, *SUN]) == 0
    with Image.open(out) as image:
        assert image.n_frames == 3
        assert image.size == (12, 12)


def test_environments_and_seeds(run: Path, tmp_path: Path) -> None:
    light = tmp_path / "map.exr"
    light.write_bytes(openexr.encode(np.ones((4, 8, 3), np.float32)))
    pictures = []
    for seed in ("1", "1", "2"):
        out = tmp_path / "x.exr"
        assert (
            main(
                ["render", str(run), "-o", str(out), "--light", str(light), "--seed", seed, *SMALL]
            )
            == 0
        )
        pictures.append(read_exr(out))
    assert np.array_equal(pictures[0], pictures[1])
    assert not np.array_equal(pictures[0], pictures[2])
    assert main(["render", str(run), "-o", str(tmp_path / "x.exr"), *SMALL]) == 0  # the studio


BAD = [
    (["--light", "lamp"], "--light lamp is no light; expected studio"),
    (["--light", ""], "--light '' is no light"),
    (["--light", "directional:30"], "--light directional:30 is malformed"),
    (["--light", "directional:30,x"], "is malformed"),
    (["--light", "directional:30,nan"], "is malformed"),
    (["--light", "directional:30,0,1,-1,1"], "expected red, green and blue not below 0"),
    (["--light", "point:0,0,3,0,0,0"], "is black"),
    (["--light", "none.exr"], "environment map none.exr cannot be read"),
    (["--light", __file__], "neither OpenEXR nor Radiance"),
    (["--camera", "fisheye"], "--camera 'fisheye' is no camera"),
    (["--camera", "perspective:0,0,0.5"], "inside the sphere"),
    (["--light", "point:0,0,0.5"], "the light at (0, 0, 0.5) lies inside the sphere"),
    (["--camera", "perspective:0"], "is malformed"),
    (["--camera", "perspective:0,0,3,180"], "field of view is 180 degrees"),
    (["--shape", "plane", "--camera", "orthographic:120,0"], "sees nothing of the plane"),
    (["--shape", "torus"], "argument --shape: invalid choice: 'torus' (choose from"),
    (["--turn", "table"], "argument --turn: invalid choice: 'table'"),
    (["--turntable", "1"], "--turntable is 1"),
    (["--turntable", "4"], "is no .gif"),
    (["--repeat", "0"], "--repeat is 0.0; expected 0.001 to 1000.0"),
    (["--size", "0"], "--size is 0; expected 1 to 4096"),
    (["--size", "many"], "--size is 'many'; expected a whole number"),
    (["--samples", "0"], "--samples is 0; expected 1 to 4096"),
    (["--exposure", "-1"], "--exposure is '-1'"),
    (["--gamma", "0"], "--gamma is 0.0"),
    (["--device", "abacus"], "expected auto, cpu, cuda"),
    (["--what"], "unrecognized arguments: --what"),
    (["-o", "x.jpg"], "expected .png or .exr"),
    (["--input", "none.zip"], "none.zip does not exist"),
    (["--set", "data.gamma=1"], "--set tells how a BTF is read, and there is none"),
    (["--turn", "camera"], "--turn camera is that of a turntable"),
    (["--gamma", "2", "-o", "x.exr"], "--gamma is for .png and .gif"),
    (["-o", ""], "argument -o/--output: '' is no name"),
]


@pytest.mark.parametrize(("words", "complaint"), BAD)
def test_bad_input(
    run: Path, tmp_path: Path, refused: Callable[..., str], words: list[str], complaint: str
) -> None:
    sentence = refused("render", run, "-o", tmp_path / "x.png", *SMALL, *words)
    assert complaint in sentence and sentence.endswith(".")
    assert {path.name for path in tmp_path.iterdir()} == {"run"}


@pytest.mark.parametrize(
    ("words", "complaint"),
    [([], "nothing to render"), (["none"], "does not exist"), (["a", "b"], "unrecognized")],
)
def test_bad_runs(
    tmp_path: Path, refused: Callable[..., str], words: list[str], complaint: str
) -> None:
    assert complaint in refused("render", *words, "-o", tmp_path / "x.png")


def test_no_output(refused: Callable[..., str]) -> None:
    assert "the following arguments are required: -o/--output" in refused("render", "x")


def test_random_numbers_of_torch_are_left_alone(run: Path, tmp_path: Path) -> None:
    torch.manual_seed(5)
    expected = torch.rand(1)
    torch.manual_seed(5)
    assert main(["render", str(run), "-o", str(tmp_path / "x.png"), *SMALL]) == 0
    assert torch.equal(torch.rand(1), expected)
