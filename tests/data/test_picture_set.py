"""UBO2003 zips and folders, written here picture by picture."""

from __future__ import annotations

import io
import math
import shutil
import zipfile
from collections.abc import Callable
from pathlib import Path

import imagecodecs
import numpy as np
import pytest
import torch
from PIL import Image

from spmm_torch.data import load_btf
from spmm_torch.errors import ConfigError, DataError
from spmm_torch.geometry.directions import ring_directions
from tests.planted.btfs import texel_major

GRID = ((0, 0), (15, 60), (75, 345))  # (theta, phi), sorted
Namer = Callable[[int, int, int, int, int], str]


def bonn_name(serial: int, tl: int, pl: int, tv: int, pv: int) -> str:
    folder = f"TEST/MANYFILES/tv{tv:03}_pv{pv:03}"
    return f"{folder}/{serial:05} tl{tl:03} pl{pl:03} tv{tv:03} pv{pv:03}.png"


def encode(pixels: np.ndarray, kind: str = "PNG", **options: object) -> bytes:
    buffer = io.BytesIO()
    Image.fromarray(pixels).save(buffer, kind, **options)
    return buffer.getvalue()


def make_files(
    codes: np.ndarray, grid: tuple = GRID, name: Namer = bonn_name
) -> list[tuple[str, bytes]]:
    """Members of a zip for `codes [V, L, H, W, 3]` whose directions follow the grid."""
    return [
        (name(light, *grid[light], *grid[view]), encode(codes[view, light]))
        for view in range(len(codes))
        for light in range(codes.shape[1])
    ]


def write_zip(path: Path, files: list[tuple[str, bytes]]) -> Path:
    with zipfile.ZipFile(path, "w") as archive:
        for name, content in files:
            archive.writestr(name, content)
    return path


def write_folder(path: Path, files: list[tuple[str, bytes]]) -> Path:
    for name, content in files:
        (path / name).parent.mkdir(parents=True, exist_ok=True)
        (path / name).write_bytes(content)
    return path


@pytest.fixture
def codes() -> np.ndarray:
    return np.random.default_rng(1).integers(0, 256, (3, 3, 4, 5, 3), dtype=np.uint8)


@pytest.fixture
def files(codes: np.ndarray) -> list[tuple[str, bytes]]:
    return make_files(codes)


def linear(codes: np.ndarray) -> torch.Tensor:
    return texel_major((codes / 255.0) ** 2.2)


@pytest.mark.parametrize("write", [write_zip, write_folder])
def test_values_in_texel_order(
    tmp_path: Path, codes: np.ndarray, files: list, write: Callable
) -> None:
    source = write(tmp_path / "wool.zip", files[::-1])
    btf = load_btf(source)
    assert (btf.height, btf.width, btf.texel_count, btf.pair_count) == (4, 5, 20, 9)
    assert (btf.path, btf.channels, btf.is_hdr, btf.bytes_per_value) == (str(source), 3, False, 1)
    assert btf.name == ("wool" if source.is_file() else "wool.zip")
    assert btf.raw_bytes == codes.size
    assert btf.peak() == 1.0
    expected = linear(codes)
    torch.testing.assert_close(btf.texels(), expected)
    index = torch.tensor([19, 0, 7, 7])
    assert torch.equal(btf.texels(index), btf.texels()[index])
    assert torch.equal(btf.texels(slice(3, 9)), btf.texels()[3:9])
    mask = torch.arange(20) % 3 == 0
    assert torch.equal(btf.texels(mask), btf.texels()[mask])
    assert btf.texels(torch.empty(0, dtype=torch.int64)).shape == (0, 9, 3)


def test_row_zero_is_the_top(tmp_path: Path, codes: np.ndarray) -> None:
    codes[:] = 0
    codes[1, 2, 0, 3] = 255  # view 1, light 2, top row, column 3
    btf = load_btf(write_zip(tmp_path / "a.zip", make_files(codes)))
    assert btf.texels().nonzero().tolist() == [[3, 1 * 3 + 2, c] for c in range(3)]
    assert btf.picture(1, 2)[0, 3].tolist() == [1.0, 1.0, 1.0]
    assert torch.equal(btf.pictures(1)[2], btf.picture(1, 2))


def test_directions(tmp_path: Path, files: list) -> None:
    btf = load_btf(write_zip(tmp_path / "a.zip", files))
    theta, phi = (
        torch.deg2rad(torch.tensor(a, dtype=torch.float64)) for a in zip(*GRID, strict=True)
    )
    expected = torch.stack(
        (theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos()), -1
    ).float()
    torch.testing.assert_close(btf.view, expected)
    wi, wo = btf.pairs()
    assert torch.equal(wi[1 * 3 + 2], btf.light[2])
    assert torch.equal(wo[1 * 3 + 2], btf.view[1])
    assert btf.view.dtype == wi.dtype == torch.float32


@pytest.mark.parametrize(
    "name",
    [
        lambda n, tl, pl, tv, pv: f"img_tv{tv}_pv{pv}_tl{tl}_pl{pl}.png",
        lambda n, tl, pl, tv, pv: f"x/PL_{pl} TV_{tv} TL {tl:04} pv{pv}.PNG",
        lambda n, tl, pl, tv, pv: f"tl999_pl999/{n}tl{tl}.0pl{pl}.00tv{tv}pv{pv - 360}.png",
    ],
)
def test_other_names(tmp_path: Path, codes: np.ndarray, name: Namer) -> None:
    btf = load_btf(write_zip(tmp_path / "a.zip", make_files(codes, name=name)))
    torch.testing.assert_close(btf.texels(), linear(codes))


def test_foreign_files_are_ignored(tmp_path: Path, codes: np.ndarray, files: list) -> None:
    first = files[0][0]
    foreign = [
        ("__MACOSX/" + first, b"mac"),
        (first.replace("00000", "._00000"), b"hidden"),
        (".cache/" + first, b"hidden"),
        ("readme.txt", b"hello"),
        (first.replace(".png", ".txt"), b"notes"),
        ("TEST/preview.png", b"not a picture"),
    ]
    btf = load_btf(write_zip(tmp_path / "a.zip", foreign + files))
    torch.testing.assert_close(btf.texels(), linear(codes))


def test_gamma(tmp_path: Path, codes: np.ndarray, files: list) -> None:
    path = write_zip(tmp_path / "a.zip", files)
    linear = load_btf(path, gamma=1.0).texels()
    torch.testing.assert_close(linear**2.2, load_btf(path).texels())
    assert (
        sorted({round(v * 255, 3) for v in linear.unique().tolist()}) == np.unique(codes).tolist()
    )
    for gamma in (0.0, -1.0, math.nan):
        with pytest.raises(ConfigError, match="gamma"):
            load_btf(path, gamma=gamma)


def test_dark_linear_codes_of_16_bits_are_no_steps(tmp_path: Path) -> None:
    deep = np.random.default_rng(5).integers(0, 500, (4, 5, 3), dtype=np.uint16)
    files = [(bonn_name(0, 0, 0, 0, 0), imagecodecs.png_encode(deep))]
    btf = load_btf(write_zip(tmp_path / "a.zip", files), gamma=1.0)
    np.testing.assert_allclose(btf.picture(0, 0).numpy(), deep / 65535.0, rtol=1e-6)
    assert btf.bytes_per_value == 2 and not btf.is_hdr


def test_pictures_saved_turned_are_upright(tmp_path: Path, codes: np.ndarray) -> None:
    """As cameras write them: half of the pictures turned, with the tag that says so."""
    exif = Image.Exif()
    exif[0x0112] = 6  # a quarter turn clockwise makes it upright
    files = make_files(codes)
    for place in range(0, len(files), 2):
        turned = np.rot90(codes.reshape(-1, 4, 5, 3)[place])
        files[place] = (files[place][0], encode(turned, exif=exif))
    btf = load_btf(write_zip(tmp_path / "a.zip", files))
    assert (btf.height, btf.width) == (4, 5)
    torch.testing.assert_close(btf.texels(), linear(codes))


def test_grey_becomes_rgb(tmp_path: Path, codes: np.ndarray, files: list) -> None:
    grey = codes[0, 0, :, :, 0]
    files[0] = (files[0][0], encode(grey))
    btf = load_btf(write_zip(tmp_path / "a.zip", files), gamma=1.0)
    expected = torch.from_numpy(grey / 255.0).float().flatten()[:, None].expand(-1, 3)
    torch.testing.assert_close(btf.texels()[:, 0], expected)


def test_lazy_progress_and_threads(tmp_path: Path, files: list) -> None:
    path = write_zip(tmp_path / "a.zip", files)
    opened = load_btf(path)
    calls: list[tuple[int, int]] = []
    btf = load_btf(path, threads=3).load(progress=lambda *call: calls.append(call))
    assert calls == [(1, 3), (2, 3), (3, 3)]
    path.unlink()
    assert btf.load(progress=lambda *call: calls.append(call)).texels().shape == (20, 9, 3)
    assert len(calls) == 3  # decoded once
    with pytest.raises(DataError, match="cannot be opened"):
        opened.texels()  # nothing had been read before


def test_full_grid_of_tiny_pictures(tmp_path: Path) -> None:
    rings = ((0, 1), (15, 6), (30, 12), (45, 18), (60, 20), (75, 24))
    grid = tuple((theta, 360 * i // count) for theta, count in rings for i in range(count))
    rng = np.random.default_rng(2)
    codes = rng.integers(0, 256, (81, 81, 2, 2, 3), dtype=np.uint8)
    btf = load_btf(write_zip(tmp_path / "a.zip", make_files(codes, grid)))
    assert btf.pair_count == 6561
    torch.testing.assert_close(btf.light, ring_directions(), atol=1e-6, rtol=0)
    torch.testing.assert_close(btf.texels(), linear(codes))


def truncated_jpeg() -> bytes:
    noise = np.random.default_rng(3).integers(0, 256, (4, 5, 3), dtype=np.uint8)
    return encode(noise, "JPEG")[:-40]


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (truncated_jpeg(), "truncated"),
        (b"", "an empty file"),
        (b"not a picture", "cannot identify"),
        (encode(np.zeros((4, 6, 3), np.uint8)), "is 6 x 4; expected 5 x 4"),
        (encode(np.zeros((4, 5, 4), np.uint8)), "transparent in places"),
        (encode(np.zeros((4, 5), np.uint16)), "has values of uint16; expected uint8"),
    ],
)
@pytest.mark.parametrize("write", [write_zip, write_folder])
def test_bad_picture_is_named(
    tmp_path: Path, files: list, write: Callable, content: bytes, message: str
) -> None:
    files[5] = (files[5][0], content)
    btf = load_btf(write(tmp_path / "a", files))
    with pytest.raises(DataError, match=message) as error:
        btf.texels()
    assert files[5][0] in str(error.value)


def test_first_picture_is_checked_at_once(tmp_path: Path, files: list) -> None:
    files[0] = (files[0][0], b"not a picture")
    with pytest.raises(DataError, match="tl000 pl000 tv000 pv000.png"):
        load_btf(write_zip(tmp_path / "a.zip", files))


def test_damaged_member(tmp_path: Path, files: list) -> None:
    path = write_zip(tmp_path / "a.zip", files)
    with zipfile.ZipFile(path) as archive:
        offset = archive.infolist()[4].header_offset
    content = bytearray(path.read_bytes())
    content[offset + 30 + len(files[4][0]) + 10] ^= 0xFF
    path.write_bytes(content)
    with pytest.raises(DataError, match="CRC") as error:
        load_btf(path).texels()
    assert files[4][0] in str(error.value)


def test_missing_pair(tmp_path: Path, files: list) -> None:
    del files[5]  # view 1, light 2
    with pytest.raises(DataError) as error:
        load_btf(write_zip(tmp_path / "a.zip", files))
    assert "lacks the pair light (theta 75, phi 345), view (theta 15, phi 60)" in str(error.value)
    assert "1 missing of 9" in str(error.value)


def test_doubled_pair(tmp_path: Path, files: list) -> None:
    other = files[5][0].replace("TEST/", "OTHER/")
    with pytest.raises(DataError, match="twice") as error:
        load_btf(write_zip(tmp_path / "a.zip", [*files, (other, files[5][1])]))
    for part in (files[5][0], other, "light (theta 75, phi 345), view (theta 15, phi 60)"):
        assert part in str(error.value)


def test_azimuth_at_the_pole_is_no_new_direction(tmp_path: Path, files: list) -> None:
    other = files[0][0].replace("tl000 pl000", "tl000 pl090")
    with pytest.raises(DataError, match="twice"):
        load_btf(write_zip(tmp_path / "a.zip", [*files, (other, files[0][1])]))


def test_under_the_horizon(tmp_path: Path, files: list) -> None:
    low = [(name.replace("tl075", "tl105"), content) for name, content in files]
    with pytest.raises(DataError, match="105 degrees, under the horizon"):
        load_btf(write_zip(tmp_path / "a.zip", low))


def test_all_black(tmp_path: Path, codes: np.ndarray) -> None:
    btf = load_btf(write_zip(tmp_path / "a.zip", make_files(np.zeros_like(codes))))
    with pytest.raises(DataError, match="all black"):
        btf.texels()


def test_folder_that_vanishes(tmp_path: Path, files: list) -> None:
    btf = load_btf(write_folder(tmp_path / "a", files))
    shutil.rmtree(tmp_path / "a")
    with pytest.raises(DataError, match="cannot be"):
        btf.texels()


@pytest.mark.skipif(not torch.cuda.is_available(), reason="no CUDA device")
def test_codes_are_expanded_to_the_same_bits_on_cuda(tmp_path: Path, files: list) -> None:
    btf = load_btf(write_zip(tmp_path / "a.zip", files))
    index = torch.tensor([4, 19, 0])
    assert torch.equal(btf.texels(index, device="cuda").cpu(), btf.texels(index))
