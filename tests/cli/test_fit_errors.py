"""Bad input to `spmm fit`: one clear sentence, exit code 2, and nothing half-written."""

from __future__ import annotations

import io
import os
import subprocess
import sys
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from spmm_torch.cli.main import main
from spmm_torch.geometry.directions import ring_directions
from tests.locations import CONFIGS, ROOT

SMOKE = CONFIGS / "smoke.yaml"
ANGLES = ((0, 0), (45, 90))
DIRECTIONS = ring_directions(((0.0, 1), (45.0, 4))).numpy()
SHAPE = (5, 5, 2, 3, 3)
BROKEN = "00003 tl045 pl090 tv045 pv090.jpg"
Maker = Callable[[Path], Path]


def jpeg(size: tuple[int, int] = (16, 16), black: bool = False) -> bytes:
    pixels = np.random.default_rng(0).integers(1, 256, (*size, 3), dtype=np.uint8)
    buffer = io.BytesIO()
    Image.fromarray(pixels * (not black)).save(buffer, "JPEG")
    return buffer.getvalue()


def pictures(black: bool = False) -> dict[str, bytes]:
    """All pairs of two lights and two views."""
    pairs = [(light, view) for view in ANGLES for light in ANGLES]
    return {
        f"{serial:05} tl{tl:03} pl{pl:03} tv{tv:03} pv{pv:03}.jpg": jpeg(black=black)
        for serial, ((tl, pl), (tv, pv)) in enumerate(pairs)
    }


def zipped(files: dict[str, bytes]) -> Maker:
    def make(folder: Path) -> Path:
        with zipfile.ZipFile(folder / "btf.zip", "w") as archive:
            for name, content in files.items():
                archive.writestr(name, content)
        return folder / "btf.zip"

    return make


def saved(**changes: object) -> Maker:
    def make(folder: Path) -> Path:
        values = np.random.default_rng(0).random(SHAPE).astype(np.float32)
        arrays = {"values": values, "view": DIRECTIONS, "light": DIRECTIONS} | changes
        np.savez(folder / "btf.npz", **arrays)
        return folder / "btf.npz"

    return make


def with_value(value: float) -> Maker:
    values = np.ones(SHAPE, np.float32)
    values[1, 2, 1, 0, 2] = value
    return saved(values=values)


def text_file(folder: Path) -> Path:
    (folder / "btf.zip").write_text("not a zip")
    return folder / "btf.zip"


INPUTS: dict[str, tuple[Maker, str]] = {
    "missing file": (lambda folder: folder / "no.zip", "no.zip does not exist"),
    "not a zip": (text_file, "is neither a complete zip nor a folder"),
    "no BTF names": (zipped({"readme.txt": b"hello"}), "is a zip without BTF pictures"),
    "truncated JPEG": (zipped(pictures() | {BROKEN: jpeg()[:-200]}), f"'{BROKEN}'"),
    "missing pair": (
        zipped({name: data for name, data in pictures().items() if name != BROKEN}),
        "lacks the pair light (theta 45, phi 90), view (theta 45, phi 90)",
    ),
    "doubled pair": (zipped(pictures() | {"x " + BROKEN: jpeg()}), "holds the pair light"),
    "other size": (zipped(pictures() | {BROKEN: jpeg((16, 24))}), "is 24 x 16; expected 16 x 16"),
    "black pictures": (zipped(pictures(black=True)), "is all black"),
    "black array": (saved(values=np.zeros(SHAPE, np.float32)), "is all black"),
    "nan": (with_value(np.nan), "holds nan at [view 1, light 2, row 1, column 0, channel 2]"),
    "infinity": (with_value(np.inf), "holds inf at"),
    "negative": (with_value(-1.0), "holds -1.0 at"),
    "under the horizon": (
        saved(light=DIRECTIONS * np.float32([1, 1, -1])),
        "under the horizon",
    ),
    "not unit": (saved(view=DIRECTIONS * np.float32(1.1)), "not unit"),
}
SETTINGS: dict[str, tuple[list[str], str]] = {
    "unknown key": (["--set", "serach.restarts=2"], "did you mean search"),
    "unknown inner key": (["--set", "search.restart=2"], "did you mean search.restarts?"),
    "bad value": (["--set", "cluster.count=none"], "expected a whole number"),
    "out of range": (["--set", "cluster.count=0"], "expected at least 1"),
    "no value": (["--set", "seed"], "expected KEY=VALUE"),
    "negative seed": (["--seed", "-1"], "seed is -1"),
    "huge seed": (["--seed", "9" * 23], "expected 0 to 9223372036854775807"),
    "half a seed": (["--seed", "1.5"], "seed is 1.5; expected a whole number"),
    "no such device": (["--device", "abacus"], "expected auto, cpu, cuda or cuda:N"),
    "device too far": (["--device", "cuda:99"], "use --device cpu"),
    "other device": (["--device", "meta"], "expected auto, cpu, cuda or cuda:N"),
    "no scene": (["--scene", "no.yaml"], "no.yaml cannot be read"),
    "apostrophe": (["--scene", "it's.yaml"], "it's.yaml cannot be read"),
    "no rectangle": (["--crop", "1,2,3"], "'1,2,3' is no rectangle; expected X,Y,WIDTH,HEIGHT"),
    "no weights": (["--weights", "no.npz"], "weights no.npz cannot be read"),
    "bad floor": (["--set", "weights.floor=2"], "weights.floor is 2.0; expected 0.0 to 1.0"),
    "bad error": (
        ["--set", "weights.error=l1"],
        "expected one of auto, l2, balanced, cube-root, log",
    ),
    "bad missing": (["--set", "data.missing=fill"], "expected one of refuse, mask"),
    "no settings file": (["--config", "no.yaml"], "no.yaml cannot be read"),
}


Check = Callable[[list[str], str], None]


@pytest.fixture
def out(tmp_path: Path) -> Path:
    (tmp_path / "out").mkdir()
    return tmp_path / "out"


@pytest.fixture
def check_refused(out: Path, refused: Callable[..., str]) -> Check:
    """A fit that ends with a sentence, and leaves `out` untouched."""

    def check(arguments: list[str], message: str) -> None:
        before = sorted(out.rglob("*"))
        assert message in refused("fit", *arguments)
        assert sorted(out.rglob("*")) == before

    return check


@pytest.mark.parametrize("case", INPUTS)
def test_bad_input(tmp_path: Path, out: Path, case: str, check_refused: Check) -> None:
    make, message = INPUTS[case]
    options = ["-o", str(out / "run"), "--config", str(SMOKE), "--device", "cpu"]
    check_refused([str(make(tmp_path)), *options], message)


@pytest.mark.parametrize("case", SETTINGS)
def test_bad_settings(tmp_path: Path, out: Path, case: str, check_refused: Check) -> None:
    options, message = SETTINGS[case]
    source = str(saved()(tmp_path))
    check_refused([source, "-o", str(out / "run"), *options], message)


WEIGHTS: dict[str, tuple[np.ndarray, str]] = {
    "shape": (np.ones((3, 5)), "'pair' of weights w.npz has shape [3, 5]; expected [5, 5]"),
    "negative": (-np.ones((5, 5)), "holds -1.0 at [0, 0]"),
    "nan": (np.full((5, 5), np.nan), "holds nan at [0, 0]"),
    "zero": (np.zeros((5, 5)), "is 0 wherever something was measured"),
}


@pytest.mark.parametrize("case", WEIGHTS)
def test_bad_weights(
    tmp_path: Path,
    out: Path,
    case: str,
    check_refused: Check,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    array, message = WEIGHTS[case]
    monkeypatch.chdir(tmp_path)
    np.savez("w.npz", pair=array)
    arguments = [str(saved()(tmp_path)), "-o", str(out / "run"), "--weights", "w.npz"]
    check_refused(arguments, message)


def test_a_scene_that_sees_nothing(tmp_path: Path, out: Path, check_refused: Check) -> None:
    scene = tmp_path / "scene.yaml"
    scene.write_text("{shape: plane, camera: 'orthographic:150,0', size: 8}", encoding="utf-8")
    arguments = [str(saved()(tmp_path)), "-o", str(out / "run"), "--scene", str(scene)]
    check_refused(arguments, "its camera sees nothing of the shape")


def test_unknown_key_in_a_file(tmp_path: Path, out: Path, check_refused: Check) -> None:
    settings = tmp_path / "mine.yaml"
    settings.write_text("cluster: {cuont: 3}\n", encoding="utf-8")
    arguments = [str(saved()(tmp_path)), "-o", str(out / "run"), "--config", str(settings)]
    check_refused(arguments, "cluster.cuont; did you mean cluster.count?")


def test_existing_run(tmp_path: Path, out: Path, check_refused: Check) -> None:
    (out / "run").mkdir()
    (out / "run" / "mine").write_text("mine")
    arguments = [str(saved()(tmp_path)), "-o", str(out / "run"), "--config", str(SMOKE)]
    check_refused(arguments, "run exists; expected a new name")
    assert (out / "run" / "mine").read_text() == "mine"


def test_run_below_a_file(tmp_path: Path, out: Path, check_refused: Check) -> None:
    source = saved()(tmp_path)
    check_refused([str(source), "-o", str(source / "run")], "cannot be written")


def test_as_a_process(tmp_path: Path, out: Path) -> None:
    command = [sys.executable, "-m", "spmm_torch.fit", str(tmp_path / "no.zip")]
    process = subprocess.run(
        [*command, "-o", str(out / "run")],
        cwd=ROOT,
        env={**os.environ, "OMP_NUM_THREADS": "1"},
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert process.returncode == 2
    assert process.stderr.startswith("error: ")
    assert process.stderr.count("\n") == 1
    assert process.stdout == ""
    assert not any(out.iterdir())


def test_more_clusters_than_texels(
    tmp_path: Path, out: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = [str(saved()(tmp_path)), "-o", str(out / "run"), "--config", str(SMOKE)]
    arguments += ["--device", "cpu", "--no-render", "--set", "cluster.count=50"]
    assert main(["fit", *arguments]) == 0
    warning = "warning: cluster.count lowered from 50 to 6, there are only 6 texels"
    assert warning in capsys.readouterr().err.splitlines()
    assert warning in (out / "run" / "log.txt").read_text(encoding="utf-8").splitlines()
