"""ATRIUM and OpenEXR picture sets: values without a limit, and formats told by content."""

from __future__ import annotations

import io
import zipfile
from pathlib import Path

import numpy as np
import OpenEXR
import pytest
import torch
from PIL import Image

from spmm_torch.data import Selection, load_btf
from spmm_torch.data.codecs import openexr, radiance
from spmm_torch.errors import DataError
from tests.data.test_picture_set import write_zip
from tests.planted.btfs import texel_major
from tests.planted.pictures import encode_atrium, encode_png, random_codes, write_pictures

V, L, H, W = 3, 2, 4, 9
HALF_MAX = 65504.0


def exact_rgbe(codes: np.ndarray) -> np.ndarray:
    """The format's own words: the mantissas times two to the exponent, less 128 and 8."""
    exponent = codes[..., 3:].astype(int)
    values = codes[..., :3] / 256.0 * 2.0 ** (exponent - 128)
    return np.where(exponent == 0, 0.0, values)


@pytest.fixture
def codes() -> np.ndarray:
    return random_codes("rgbe", (V, L, H, W))


@pytest.fixture
def values() -> np.ndarray:
    return random_codes("float32", (V, L, H, W))


@pytest.mark.parametrize("place", ["a.zip", "a"])
def test_atrium(tmp_path: Path, codes: np.ndarray, place: str) -> None:
    path = write_pictures(tmp_path / place, codes, encode_atrium, ".hdr")
    btf = load_btf(path)
    assert (btf.height, btf.width, btf.pair_count) == (H, W, V * L)
    assert torch.equal(btf.texels(), texel_major(exact_rgbe(codes)))
    assert btf.is_hdr
    assert btf.raw_bytes == codes.size  # four bytes hold three values
    expected = np.percentile(exact_rgbe(codes).astype("f4"), 99.9, method="inverted_cdf")
    assert btf.peak() == pytest.approx(expected)
    assert torch.equal(load_btf(path, gamma=1.0).texels(), btf.texels())  # they are linear


def test_rows_of_atrium_and_of_others(tmp_path: Path) -> None:
    codes = np.zeros((1, 1, H, W, 4), np.uint8)
    codes[..., 3], codes[0, 0, 0, 2, :3] = 136, (200, 100, 50)  # bright in the top row
    files = {encode_atrium: b"+X 9 -Y 4\n", radiance.encode: b"-Y 4 +X 9\n"}
    for number, (encode, resolution) in enumerate(files.items()):
        assert resolution in encode(codes[0, 0])
        btf = load_btf(write_pictures(tmp_path / f"{number}.zip", codes, encode, ".hdr"))
        assert btf.texels().nonzero().tolist() == [[2, 0, c] for c in range(3)]
        assert btf.picture(0, 0)[0, 2].tolist() == [200.0, 100.0, 50.0]


@pytest.mark.parametrize(
    ("code", "value"), [((255, 255, 255, 144), 65280.0), ((255, 1, 0, 255), 255 * 2.0**119)]
)
def test_radiance_keeps_the_maximum(
    tmp_path: Path,
    codes: np.ndarray,
    code: tuple[int, ...],
    value: float,
) -> None:
    codes[2, 1, 3, 8] = code
    path = write_pictures(tmp_path / "a.zip", codes, radiance.encode, ".hdr")
    for cache in (None, tmp_path / "cache"):
        assert float(load_btf(path).load(cache=cache).texels().max()) == value


@pytest.mark.parametrize("place", ["a.zip", "a"])
@pytest.mark.parametrize(
    ("dtype", "largest"), [(np.float16, HALF_MAX), (np.float32, float(np.finfo("f4").max))]
)
def test_exr(tmp_path: Path, values: np.ndarray, place: str, dtype: type, largest: float) -> None:
    values = values.astype(dtype)
    values[1, 0, 2, 3, 1] = largest
    btf = load_btf(write_pictures(tmp_path / place, values, openexr.encode, ".exr"))
    assert torch.equal(btf.texels(), texel_major(values))
    assert btf.load()._store.codes.rows(None).dtype == torch.from_numpy(values).dtype
    assert (btf.bytes_per_value, btf.raw_bytes) == (values.itemsize, values.nbytes)
    assert btf.is_hdr and float(btf.texels().max()) == largest
    np.testing.assert_array_equal(btf.picture(1, 0).numpy(), values[1, 0].astype("f4"))


def test_floats_up_to_one_are_no_hdr(tmp_path: Path) -> None:
    values = np.random.default_rng(0).random((V, L, H, W, 3), dtype=np.float32)
    values[0, 0, 0, 0, 0] = 1.0
    btf = load_btf(write_pictures(tmp_path / "a.zip", values, openexr.encode, ".exr"))
    assert (btf.is_hdr, btf.peak()) == (False, 1.0)


def test_hdr_is_a_matter_of_the_part(tmp_path: Path, values: np.ndarray) -> None:
    values /= values.max()
    values[2, 1, 3, 8, 0] = 7.0
    path = write_pictures(tmp_path / "a.zip", values, openexr.encode, ".exr")
    assert load_btf(path).is_hdr
    for text in ("views=0,1", "lights=0"):
        assert not load_btf(path, selection=Selection(directions=text)).is_hdr


def test_half_floats_among_floats_are_widened(tmp_path: Path, values: np.ndarray) -> None:
    half = values[1, 1].astype(np.float16)
    changes = {(1, 1): openexr.encode(half)}
    path = write_pictures(tmp_path / "a.zip", values, openexr.encode, ".exr", changes)
    values[1, 1] = half
    assert torch.equal(load_btf(path).texels(), texel_major(values))


@pytest.mark.parametrize("cached", [False, True])
def test_floats_among_half_floats_widen_all(
    tmp_path: Path, values: np.ndarray, cached: bool
) -> None:
    changes = {(1, 1): openexr.encode(values[1, 1])}
    half = values.astype(np.float16)
    path = write_pictures(tmp_path / "a.zip", half, openexr.encode, ".exr", changes)
    expected = half.astype(np.float32)
    expected[1, 1] = values[1, 1]
    btf = load_btf(path).load(cache=tmp_path / "cache" if cached else None)
    assert torch.equal(btf.texels(), texel_major(expected))


KINDS = ("png", "Radiance", "OpenEXR")


@pytest.mark.parametrize("first", KINDS)
@pytest.mark.parametrize("other", KINDS)
def test_mixed_kinds(tmp_path: Path, codes: np.ndarray, first: str, other: str) -> None:
    values = exact_rgbe(codes).astype(np.float32)
    kinds = {
        "png": (codes[..., :3].copy(), encode_png),
        "Radiance": (codes, radiance.encode),
        "OpenEXR": (values, openexr.encode),
    }
    pictures, encode = kinds[first]
    others, encode_other = kinds[other]
    changes = {(2, 1): encode_other(others[2, 1])}
    btf = load_btf(write_pictures(tmp_path / "a.zip", pictures, encode, ".exr", changes))
    if first == other:
        assert btf.texels().shape == (H * W, V * L, 3)
        return
    message = "cannot identify" if first == "png" else f"not stored like the first one, as {first}"
    with pytest.raises(DataError, match=message) as error:
        btf.texels()
    assert "tl015 pl060 tv030 pv090.exr" in str(error.value)


@pytest.mark.parametrize("suffix", [".jpg", ".png", ".hdr", ".exr", ".PIC"])
def test_content_decides_and_not_the_suffix(
    tmp_path: Path,
    codes: np.ndarray,
    values: np.ndarray,
    suffix: str,
) -> None:
    eight_bits = codes[..., :3].copy()
    cases = {
        "png": (eight_bits, encode_png, texel_major((eight_bits / 255.0) ** 2.2)),
        "atrium": (codes, encode_atrium, texel_major(exact_rgbe(codes))),
        "exr": (values, openexr.encode, texel_major(values)),
    }
    for name, (pictures, encode, expected) in cases.items():
        path = write_pictures(tmp_path / f"{name}.dat", pictures, encode, suffix)
        torch.testing.assert_close(load_btf(path).texels(), expected, rtol=1e-6, atol=0)


def test_jpeg_and_png_may_be_mixed(tmp_path: Path, codes: np.ndarray) -> None:
    pictures = codes[..., :3].copy()
    buffer = io.BytesIO()
    Image.fromarray(pictures[1, 0]).save(buffer, "JPEG", quality=90)
    changes = {(1, 0): buffer.getvalue()}
    path = write_pictures(tmp_path / "a.zip", pictures, encode_png, ".png", changes)
    pictures[1, 0] = np.asarray(Image.open(buffer))
    btf = load_btf(path, gamma=1.0)
    torch.testing.assert_close(btf.texels(), texel_major(pictures / 255.0))


@pytest.mark.parametrize(
    ("value", "shown"), [(np.nan, "nan"), (np.inf, "inf"), (-0.25, "-0.25"), (-np.inf, "-inf")]
)
@pytest.mark.parametrize("dtype", [np.float16, np.float32])
def test_values_that_are_not_valid(
    tmp_path: Path,
    values: np.ndarray,
    value: float,
    shown: str,
    dtype: type,
) -> None:
    values[2, 1, 3, 7, 0] = value
    path = write_pictures(tmp_path / "a.zip", values.astype(dtype), openexr.encode, ".exr")
    place = rf"{shown} at \[view 2, light 1, row 3, column 7, channel 0\]"
    for loading in ({}, {"cache": tmp_path / "cache", "memory": 1}):
        with pytest.raises(DataError, match=place):
            load_btf(path).load(**loading)
    rest = load_btf(path, selection=Selection(directions="views=0,1"))
    assert rest.texels().shape == (H * W, 2 * L, 3)


@pytest.mark.parametrize("kind", ["rgbe", "float16", "float32"])
def test_broken_pictures_are_named(tmp_path: Path, kind: str) -> None:
    pictures = random_codes(kind, (V, L, H, W))
    encode = radiance.encode if kind == "rgbe" else openexr.encode
    good = encode(pictures[1, 1])
    broken = [good[:-9], good[:20], b"noise", encode(pictures[1, 1, 1:].copy())]
    for number, content in enumerate(broken):
        changes = {(1, 1): content}
        path = write_pictures(tmp_path / f"{number}.zip", pictures, encode, ".hdr", changes)
        with pytest.raises(DataError) as error:
            load_btf(path).texels()
        assert "tl015 pl060 tv015 pv060.hdr" in str(error.value)
        changes = {(0, 0): content}
        path = write_pictures(tmp_path / f"{number}.zip", pictures, encode, ".hdr", changes)
        with pytest.raises(DataError) as error:  # at once, or where the second one differs
            load_btf(path).texels()
        assert str(path) in str(error.value) and "\n" not in str(error.value)


def test_pictures_of_another_size(tmp_path: Path, values: np.ndarray) -> None:
    changes = {(1, 1): openexr.encode(values[1, 1, :, 1:].copy())}
    btf = load_btf(write_pictures(tmp_path / "a.zip", values, openexr.encode, ".exr", changes))
    with pytest.raises(DataError, match=r"is 8 x 4; expected 9 x 4 like the first one"):
        btf.texels()


def test_grey_exr(tmp_path: Path, values: np.ndarray) -> None:
    OpenEXR = pytest.importorskip("OpenEXR")
    grey = np.ascontiguousarray(values[1, 1, :, :, 0])
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    buffer = io.BytesIO()
    OpenEXR.File(header, {"Y": grey}).write(buffer)
    changes = {(1, 1): buffer.getvalue()}
    path = write_pictures(tmp_path / "a.zip", values, openexr.encode, ".exr", changes)
    values[1, 1] = grey[..., None]
    assert torch.equal(load_btf(path).texels(), texel_major(values))


def test_hidden_and_foreign_files_are_left_out(tmp_path: Path, values: np.ndarray) -> None:
    path = write_pictures(tmp_path / "a.zip", values, openexr.encode, ".exr")
    with zipfile.ZipFile(path, "a") as archive:
        archive.writestr("__MACOSX/X/tl000 pl000 tv000 pv000.exr", b"mac")
        archive.writestr("X/preview.exr", b"not a picture of the set")
    assert torch.equal(load_btf(path).texels(), texel_major(values))


def moved(picture: np.ndarray, column: int) -> bytes:
    """An EXR that holds a part of a frame of 10 x 10 pixels, from a column on."""
    last = (column + picture.shape[1] - 1, picture.shape[0] - 1)
    header = {
        "compression": OpenEXR.ZIP_COMPRESSION,
        "type": OpenEXR.scanlineimage,
        "dataWindow": (np.array((column, 0), np.int32), np.array(last, np.int32)),
        "displayWindow": (np.zeros(2, np.int32), np.full(2, 9, np.int32)),
    }
    buffer = io.BytesIO()
    OpenEXR.File(header, {"RGB": np.ascontiguousarray(picture)}).write(buffer)
    return buffer.getvalue()


@pytest.mark.parametrize(("columns", "fine"), [((3, 3), True), ((0, 1), False)])
def test_parts_of_frames_must_be_the_same_part(
    tmp_path: Path, columns: tuple[int, int], fine: bool
) -> None:
    """As programs write them that cut black borders off: of one size, but of other texels."""
    picture = np.random.default_rng(4).random((4, 5, 3), dtype=np.float32)
    names = ("tl000 pl000 tv000 pv000.exr", "tl015 pl000 tv000 pv000.exr")
    files = [(name, moved(picture, at)) for name, at in zip(names, columns, strict=True)]
    btf = load_btf(write_zip(tmp_path / "a.zip", files))
    if fine:
        assert torch.equal(btf.load().picture(0, 1), torch.from_numpy(picture))
        return
    with pytest.raises(DataError, match=r"the part of its frame from \(1, 0\) on; expected that"):
        btf.load()
