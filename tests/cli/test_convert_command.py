"""The command `spmm convert`: every format in and out, and nothing half-written."""

from __future__ import annotations

import io
import math
import zipfile
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image

from spmm_torch.cli.main import main
from spmm_torch.data import BTF, load_btf
from spmm_torch.data.codecs import openexr
from spmm_torch.data.writers import WRITERS, write_npz, writer_of
from spmm_torch.errors import ConfigError
from spmm_torch.geometry.directions import ring_directions

DIRECTIONS = ring_directions(((0.0, 1), (22.5, 2), (60.0, 3)))


def pixels(name: str) -> np.ndarray:
    """Codes `[7, 8, 3]` of a picture, other ones for each name."""
    rng = np.random.default_rng(zlib.crc32(name.encode()))
    return rng.integers(0, 256, (7, 8, 3), dtype=np.uint8)


@pytest.fixture
def pictures(tmp_path: Path) -> Path:
    """A UBO2003 zip of 2 views, 3 lights and 7 x 8 texels."""
    with zipfile.ZipFile(tmp_path / "LINEN.zip", "w") as archive:
        for view in (0, 30):
            for light in (0, 120, 240):
                name = f"tl015 pl{light:03} tv{view:03} pv000.png"
                buffer = io.BytesIO()
                Image.fromarray(pixels(name)).save(buffer, "PNG")
                archive.writestr(name, buffer.getvalue())
    return tmp_path / "LINEN.zip"


@pytest.fixture
def hdr(tmp_path: Path) -> BTF:
    """An HDR BTF of 6 x 6 directions and 5 x 4 texels, saved as hdr.npz."""
    values = np.random.default_rng(0).gamma(1.0, 2.0, (6, 6, 5, 4, 3)).astype(np.float32)
    values[2, 3, 1, 2] = 70_000.0
    btf = BTF.from_values(values, DIRECTIONS, DIRECTIONS)
    write_npz(tmp_path / "hdr.npz", btf)
    return btf


def relative_error(found: torch.Tensor, expected: torch.Tensor) -> float:
    return float((found - expected).norm() / expected.norm())


def test_zip_to_npz_and_back(
    tmp_path: Path, pictures: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["convert", str(pictures), "-o", str(tmp_path / "a.npz")]) == 0
    shown = capsys.readouterr()
    assert shown.out == f"{tmp_path / 'a.npz'}\n"
    assert "load: 2 views" in shown.err and "write: done in" in shown.err
    source = load_btf(pictures)
    assert torch.equal(load_btf(tmp_path / "a.npz").texels(), source.texels())
    assert main(["convert", str(tmp_path / "a.npz"), "-o", str(tmp_path / "b.zip"), "--png"]) == 0
    found = load_btf(tmp_path / "b.zip")
    assert torch.equal(found.texels(), source.texels())
    torch.testing.assert_close(found.light, source.light, atol=1e-6, rtol=0)


def test_jpegs_of_a_quality(tmp_path: Path, pictures: Path) -> None:
    size = {}
    for quality in (30, 95):
        path = tmp_path / f"q{quality}.zip"
        assert main(["convert", str(pictures), "-o", str(path), f"--quality={quality}"]) == 0
        size[quality] = path.stat().st_size
        with zipfile.ZipFile(path) as archive:
            assert all(name.endswith(".jpg") for name in archive.namelist())
    assert size[30] < size[95]


def test_gamma_is_of_both_ends(tmp_path: Path, pictures: Path) -> None:
    written = tmp_path / "a.zip"
    assert main(["convert", str(pictures), "-o", str(written), "--png", "--gamma=1.8"]) == 0
    for gamma in (1.8, 2.2):  # the codes are the same, whatever they mean
        found, expected = (load_btf(p, gamma=gamma) for p in (written, pictures))
        assert torch.equal(found.texels(), expected.texels())


def test_a_missing_cosine_is_multiplied_in(tmp_path: Path, hdr: BTF) -> None:
    source, written = tmp_path / "hdr.npz", tmp_path / "a.npz"
    assert main(["convert", str(source), "-o", str(written), "--cosine", "missing"]) == 0
    cosine = DIRECTIONS[:, 2].repeat(len(DIRECTIONS))[:, None]  # [D, 1], lights fastest
    torch.testing.assert_close(load_btf(written).texels(), hdr.texels() * cosine)


def test_exr_folder(tmp_path: Path, pictures: Path, hdr: BTF) -> None:
    assert main(["convert", str(tmp_path / "hdr.npz"), "-o", f"{tmp_path / 'a'}/"]) == 0
    found = load_btf(tmp_path / "a")
    assert (found.bytes_per_value, found.is_hdr) == (4, True)
    # The reader sorts directions by their angles.
    view, light = (torch.cdist(d, DIRECTIONS).argmin(dim=1) for d in (found.view, found.light))
    for v, row in enumerate(view.tolist()):
        for l, column in enumerate(light.tolist()):  # noqa: E741
            assert torch.equal(found.picture(v, l), hdr.picture(row, column))
    assert main(["convert", str(pictures), "-o", str(tmp_path / "b.d"), "--format=exr"]) == 0
    (file, *_) = sorted((tmp_path / "b.d").rglob("*tl015 pl120 tv030 pv000.exr"))
    picture = openexr.decode(file.read_bytes())
    assert picture.dtype == np.float16
    expected = (pixels("tl015 pl120 tv030 pv000.png") / 255.0) ** 2.2
    np.testing.assert_allclose(picture, expected, rtol=1e-3, atol=1e-7)


@pytest.mark.parametrize(("scalar", "bound"), [("half", 3e-3), ("float", 1e-5), ("double", 1e-5)])
def test_btf(tmp_path: Path, pictures: Path, scalar: str, bound: float) -> None:
    path = tmp_path / "a.btf"
    assert main(["convert", str(pictures), "-o", str(path), f"--scalar={scalar}"]) == 0
    found, source = load_btf(path), load_btf(pictures)
    torch.testing.assert_close(found.view, source.view, atol=1e-6, rtol=0)
    assert relative_error(found.texels(), source.texels()) < bound


def test_components(tmp_path: Path, pictures: Path) -> None:
    error = []
    for components in (1, 3):
        path = tmp_path / f"{components}.btf"
        assert main(["convert", str(pictures), "-o", str(path), f"--components={components}"]) == 0
        error.append(relative_error(load_btf(path).texels(), load_btf(pictures).texels()))
    assert error[0] > error[1] > 0.01


def test_the_loss_of_a_btf_is_told_before_it_is_written(
    tmp_path: Path, pictures: Path, capsys: pytest.CaptureFixture[str], refused: Callable[..., str]
) -> None:
    source = load_btf(pictures).texels()
    for number, option in enumerate(("--components=2", "--snr=12", "--snr=25")):
        path = tmp_path / f"{number}.btf"
        assert main(["convert", str(pictures), "-o", str(path), option]) == 0
        loss, *after = capsys.readouterr().err.partition("the file keeps ")[2].splitlines()
        assert after[0] == "write: started"
        ratio = float(loss.partition("SNR ")[2].split()[0])
        found = -20.0 * math.log10(relative_error(load_btf(path).texels(), source))
        # What is clipped at zero makes it a little better, rounding ends it at float32.
        assert min(ratio, 100.0) - 0.05 <= found < ratio + 1.5
        assert loss.startswith("2 components") or ratio >= float(option.partition("=")[2]) - 0.05
    before = sorted(tmp_path.iterdir())
    both = ("--snr=20", "--components=2")
    for options, message in ((both, "expected one of them"), (("--snr=900",), "snr is 900 dB")):
        assert message in refused("convert", pictures, "-o", tmp_path / "b.btf", *options)
        assert sorted(tmp_path.iterdir()) == before


def test_rows_of_a_btf(tmp_path: Path, pictures: Path) -> None:
    source = load_btf(pictures)
    for rows in ("top", "bottom"):
        path, written = tmp_path / f"{rows}.btf", tmp_path / f"{rows}.npz"
        assert main(["convert", str(pictures), "-o", str(path), "--write-rows", rows]) == 0
        assert relative_error(load_btf(path).texels(), source.texels()) < 1e-5
        unmarked = path.read_bytes().replace(b"<?spmm rows=", b"<?none rows=")
        path.write_bytes(unmarked)
        assert main(["convert", str(path), "-o", str(written), "--rows", rows]) == 0
        assert relative_error(load_btf(written).texels(), source.texels()) < 1e-5


def test_btf_to_everything(tmp_path: Path, pictures: Path) -> None:
    assert main(["convert", str(pictures), "-o", str(tmp_path / "a.btf")]) == 0
    source = load_btf(tmp_path / "a.btf")
    for name in ("b.npz", "b", "b.btf"):
        assert main(["convert", str(tmp_path / "a.btf"), "-o", str(tmp_path / name)]) == 0
        assert relative_error(load_btf(tmp_path / name).texels(), source.texels()) < 1e-3


def refusals(tmp_path: Path) -> Iterator[tuple[list[str], str]]:
    """Arguments that are refused, and what is said."""
    (tmp_path / "there").mkdir()
    (tmp_path / "link").symlink_to(tmp_path / "nowhere")
    zipped, floats = str(tmp_path / "LINEN.zip"), str(tmp_path / "hdr.npz")
    out = str(tmp_path / "out")
    yield [zipped, "-o", str(tmp_path / "there")], "there exists; expected a new name"
    yield [zipped, "-o", zipped], "LINEN.zip exists"
    yield [zipped, "-o", str(tmp_path / "link"), "--format=npz"], "link exists"
    yield [str(tmp_path / "no.zip"), "-o", out], "no.zip does not exist"
    yield [zipped, "-o", f"{out}.tif"], "ends in .tif, which names no format"
    yield [zipped, "-o", f"{out}.zip", "--format=exr"], "out.zip does not fit --format exr"
    yield [zipped, "-o", f"{out}.npz", "--format=ubo2003"], "expected a name in .zip"
    yield [zipped, "-o", f"{out}/deeper/a.npz"], "cannot be written"
    yield [zipped, "-o", f"{out}/deeper/a"], "cannot be written"
    yield [zipped, "-o", f"{out}.zip", "--quality=0"], "quality is 0"
    yield [zipped, "-o", f"{out}.npz", "--snr=30"], "--snr is an option of --format btf"
    yield [zipped, "-o", f"{out}.btf", "--png"], "--png is an option of --format ubo2003"
    yield [zipped, "-o", f"{out}.zip", "--gamma=0"], "gamma is 0"
    yield [zipped, "-o", f"{out}.btf", "--components=0"], "components is 0"
    yield [floats, "-o", f"{out}.zip"], "expected 0 to 1, as 8 bits hold; write EXR or NPZ"


def test_refusals(tmp_path: Path, pictures: Path, hdr: BTF, refused: Callable[..., str]) -> None:
    cases = list(refusals(tmp_path))
    before = sorted(tmp_path.rglob("*"))
    for arguments, message in cases:
        assert message in refused("convert", *arguments)
        assert sorted(tmp_path.rglob("*")) == before


def test_a_broken_picture_leaves_nothing(
    tmp_path: Path, pictures: Path, refused: Callable[..., str]
) -> None:
    with zipfile.ZipFile(pictures) as source:
        members = {name: source.read(name) for name in source.namelist()}
    broken = "tl015 pl240 tv030 pv000.png"
    with zipfile.ZipFile(tmp_path / "broken.zip", "w") as archive:
        for name, content in members.items():
            archive.writestr(name, content[:-30] if name == broken else content)
    before = sorted(tmp_path.iterdir())
    for name in ("a.npz", "a.zip", "a", "a.btf"):
        assert broken in refused("convert", tmp_path / "broken.zip", "-o", tmp_path / name)
        assert sorted(tmp_path.iterdir()) == before


def test_formats_of_names() -> None:
    names = {
        "a.npz": "npz",
        "x/A.NPZ": "npz",
        "a.zip": "ubo2003",
        "a.btf": "btf",
        "a": "exr",
        "x.y/a": "exr",
        "carpet.v2/": "exr",
    }
    assert {name: writer_of(name).name for name in names} == names
    assert set(names.values()) == set(WRITERS)
    with pytest.raises(ConfigError, match="--format"):
        writer_of("carpet.v2")
