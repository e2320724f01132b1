"""RTI sets: one view, a light for each picture, and intensities."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import torch
from torch import Tensor

from spmm_torch.cli.main import main
from spmm_torch.data import load_btf
from spmm_torch.data.codecs import openexr
from spmm_torch.errors import DataError
from spmm_torch.model.spmm import SPMM
from tests.cli.test_resume import OPTIONS
from tests.data.test_picture_set import encode, write_folder, write_zip

CODES = np.random.default_rng(1).integers(1, 256, (4, 3, 5, 3), dtype=np.uint8)  # [L, H, W, 3]
LIGHTS = np.array([[0.0, 0.0, 2.0], [0.6, 0.0, 0.8], [0.0, -0.6, 0.8], [-30.0, 40.0, 50.0]])
NAMES = ("a 1.png", "a 2.png", "b.png", "c.png")
INTENSITY = np.array([[1.0, 1.0, 1.0], [2.0, 1.0, 0.5], [0.5, 0.5, 0.5], [4.0, 2.0, 1.0]])


def lp(names: tuple[str, ...] = NAMES, extra: np.ndarray | None = None) -> bytes:
    rows = LIGHTS if extra is None else np.hstack([LIGHTS, extra])
    lines = [" ".join([name, *map(str, row)]) for name, row in zip(names, rows, strict=True)]
    return "\n".join([str(len(lines)), *lines, ""]).encode()


def pictures(folder: str = "") -> list[tuple[str, bytes]]:
    return [(folder + name, encode(codes)) for name, codes in zip(NAMES, CODES, strict=True)]


def expected() -> Tensor:
    """Values `[T, L, 3]`."""
    return torch.from_numpy((CODES / 255.0) ** 2.2).float().permute(1, 2, 0, 3).reshape(15, 4, 3)


@pytest.mark.parametrize("write", [write_zip, write_folder])
def test_values_and_directions(tmp_path: Path, write: Callable) -> None:
    path = write(tmp_path / "coin", [("coin.lp", lp()), ("notes.txt", b"x"), *pictures()])
    btf = load_btf(path)
    assert (btf.height, btf.width, btf.pair_count, btf.name) == (3, 5, 4, "coin")
    torch.testing.assert_close(btf.texels(), expected())
    torch.testing.assert_close(btf.view, torch.tensor([[0.0, 0.0, 1.0]]))
    unit = LIGHTS / np.linalg.norm(LIGHTS, axis=1, keepdims=True)
    torch.testing.assert_close(btf.light, torch.from_numpy(unit).float())
    assert not btf.is_hdr
    assert btf.notes == (
        "note: one view, from straight above: what other views would show is a guess",
    )


def test_the_list_itself_is_an_input(tmp_path: Path) -> None:
    write_folder(tmp_path / "coin", [("x.lp", lp()), ("y.lp", lp()), *pictures()])
    btf = load_btf(tmp_path / "coin" / "x.lp")
    assert (btf.name, btf.path) == ("x", str(tmp_path / "coin" / "x.lp"))
    torch.testing.assert_close(btf.texels(), expected())
    with pytest.raises(DataError, match="holds 2 lists of lights, 'x.lp' and 'y.lp' among them"):
        load_btf(tmp_path / "coin")


@pytest.mark.parametrize(
    "prefix", ["", "../jpeg/", "C:\\scans\\coin\\jpeg\\", "/home/me/coin/jpeg/", "jpeg/"]
)
def test_pictures_are_found_by_path_or_name(tmp_path: Path, prefix: str) -> None:
    names = tuple(prefix + name.upper() for name in NAMES)
    files = [("lists/coin.lp", lp(names)), *pictures("jpeg/")]
    torch.testing.assert_close(load_btf(write_zip(tmp_path / "a.zip", files)).texels(), expected())


def test_a_path_tells_pictures_of_one_name_apart(tmp_path: Path) -> None:
    other = [(f"small/{name}", b"x") for name in NAMES]
    names = tuple(f"jpeg/{name}" for name in NAMES)
    files = [("coin.lp", lp(names)), *pictures("jpeg/"), *other]
    btf = load_btf(write_zip(tmp_path / "a.zip", files))
    torch.testing.assert_close(btf.texels(), expected())
    assert "no part of the BTF" in btf.notes[1] and "'small/a 1.png' and 3 more" in btf.notes[1]
    vague = write_zip(tmp_path / "b.zip", [("coin.lp", lp()), *files[1:]])
    with pytest.raises(DataError, match="'jpeg/a 1.png' or 'small/a 1.png'; expected one"):
        load_btf(vague)


def with_numbers(path: Path) -> Path:
    return write_zip(path, [("coin.lp", lp(extra=INTENSITY)), *pictures()])


def with_a_file(path: Path) -> Path:
    lines = "\n".join(" ".join(map(str, row)) for row in INTENSITY)
    rest = [("light_intensities.txt", lines.encode()), *pictures()]
    return write_zip(path, [("coin.lp", lp()), *rest])


@pytest.mark.parametrize("make", [with_numbers, with_a_file])
def test_values_are_divided_by_intensities(tmp_path: Path, make: Callable) -> None:
    btf = load_btf(make(tmp_path / "a.zip"))
    values = expected() / torch.from_numpy(INTENSITY).float()
    torch.testing.assert_close(btf.texels(), values)
    torch.testing.assert_close(btf.signals(), values.transpose(1, 2))
    torch.testing.assert_close(btf.picture(0, 3).reshape(15, 3), values[:, 3])
    torch.testing.assert_close(btf.views(0, 1)[:, 0], values)
    assert btf.is_hdr
    part = btf.restricted(torch.tensor([4, 2]), (1, 2), lights=torch.tensor([3, 1]))
    torch.testing.assert_close(part.texels(), values[[4, 2]][:, [3, 1]])
    cosine = load_btf(btf.path, cosine="missing")
    torch.testing.assert_close(cosine.texels(), values * btf.light[:, 2:])
    strips = cosine.load()._store.strips(torch.tensor([3, 0]), torch.tensor([0, 0]), 4)
    torch.testing.assert_close(strips, (values * btf.light[:, 2:])[[3, 0]])


def test_one_intensity_serves_all_channels(tmp_path: Path) -> None:
    path = write_zip(tmp_path / "a.zip", [("x.lp", lp(extra=INTENSITY[:, :1])), *pictures()])
    values = expected() / torch.from_numpy(INTENSITY[:, :1]).float()
    torch.testing.assert_close(load_btf(path).texels(), values)


def test_linear_pictures(tmp_path: Path) -> None:
    values = np.random.default_rng(2).gamma(1.0, 1.0, (4, 3, 5, 3)).astype(np.float32)
    names = tuple(name.replace(".png", ".exr") for name in NAMES)
    files = [(name, openexr.encode(each)) for name, each in zip(names, values, strict=True)]
    btf = load_btf(write_folder(tmp_path / "a", [("x.lp", lp(names)), *files]))
    assert btf.texels().equal(torch.from_numpy(values).permute(1, 2, 0, 3).reshape(15, 4, 3))


@pytest.mark.parametrize(
    ("files", "message"),
    [
        ([("x.lp", lp()), *pictures()[1:3]], "names 2 pictures that are not in .*, such as 'a 1.p"),
        (
            [("x.lp", b"3\na.png 0 0 1"), *pictures()],
            "says 3 lights in its first line, but names 1",
        ),
        (
            [("x.lp", lp(("a 1.png",) * 4)), *pictures()],
            "lines 2 and 3 of .* name the same picture",
        ),
        (
            [("x.lp", lp(extra=INTENSITY)), ("light_intensities.txt", b"1"), *pictures()],
            "intensities of lights are in .*x.lp and in light_intensities.txt; expected them in",
        ),
        (
            [("x.lp", lp().replace(b" 0.8\n", b" 0.8 2\n", 1)), *pictures()],
            "line 2 of .* has no intensity, but others have",
        ),
        (
            [("x.lp", lp().replace(b"0.6 0.0 0.8", b"0.0 0.0 1.0")), *pictures()],
            "the set of lights in .* holds the same direction twice, as numbers 0 and 1",
        ),
    ],
)
def test_faults(tmp_path: Path, files: list, message: str) -> None:
    with pytest.raises(DataError, match=message):
        load_btf(write_zip(tmp_path / "a.zip", files))


@pytest.mark.parametrize("suffix", [".npz", ".zip", ""])
def test_converted(tmp_path: Path, suffix: str) -> None:
    path = write_folder(tmp_path / "coin", [("coin.lp", lp()), *pictures()])
    copy = tmp_path / f"copy{suffix}"
    png = ["--png"] if suffix == ".zip" else []
    assert main(["convert", str(path), "-o", str(copy), *png]) == 0
    # The writers sort lights as names do.
    found, whole = load_btf(copy), load_btf(path)
    order = torch.cdist(found.light, whole.light).argmin(1)
    torch.testing.assert_close(found.light, whole.light[order], atol=1e-4, rtol=0)
    close = {"atol": 1e-3, "rtol": 1e-3} if suffix == "" else {"atol": 1e-6, "rtol": 1e-6}
    torch.testing.assert_close(found.texels(), whole.texels()[:, order], **close)


def test_a_fit_and_all_that_follows(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = write_folder(tmp_path / "coin", [("coin.lp", lp()), *pictures()])
    run = tmp_path / "run"
    assert main(["fit", str(path), "-o", str(run), *OPTIONS]) == 0
    log = (run / "log.txt").read_text(encoding="utf-8")
    assert log.count("one view, from straight above") == 1
    assert log.count("no relief is sought") == 1
    model = SPMM.load(run)
    assert model.relief is None
    steep = torch.nn.functional.normalize(torch.tensor([[0.8, 0.1, 0.5]]), dim=1)
    assert bool(model(torch.tensor([[0.5, 0.5]]), steep, steep).isfinite().all())
    assert main(["evaluate", str(run)]) == 0
    figures = json.loads((run / "evaluation.json").read_text(encoding="utf-8"))
    assert figures["report_difference_db"] < 0.01
