"""OpenEXR pictures: bit for bit, and an error for whatever the library reads without one."""

from __future__ import annotations

import io
import struct

import numpy as np
import OpenEXR
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from skimage.color import rgb2xyz

from spmm_torch.data.codecs import UnsuitableError, openexr
from spmm_torch.data.codecs.openexr import decode, encode, read_size

SIZES = st.tuples(st.integers(1, 40), st.integers(1, 40), st.just(3))
# Deflate leaves noise as it is, so that every byte of a file matters.
NOISE = np.random.default_rng(0).random((20, 24, 3)).astype(np.float32)


def library_bytes(channels: dict[str, np.ndarray], **attributes: object) -> bytes:
    """A file as the library writes it."""
    settings = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    buffer = io.BytesIO()
    OpenEXR.File(settings | attributes, dict(channels)).write(buffer)
    return buffer.getvalue()


@settings(max_examples=30)
@given(st.data(), st.sampled_from([np.uint16, np.uint32]), SIZES)
def test_every_bit_pattern_comes_back(data: st.DataObject, bits: type, size: tuple) -> None:
    picture = data.draw(arrays(bits, size)).view(np.float16 if bits is np.uint16 else np.float32)
    payload = encode(picture)
    found = decode(payload)
    assert openexr.accepts(payload[:16])
    assert read_size(payload) == found.shape[:2] == size[:2]
    assert found.dtype == picture.dtype and found.flags.c_contiguous
    np.testing.assert_array_equal(found.view(bits), picture.view(bits))
    assert encode(picture) == payload


def test_largest_half() -> None:
    picture = np.full((4, 5, 3), 65504.0, dtype=np.float16)
    picture[2, 3] = 6e-8
    np.testing.assert_array_equal(decode(encode(picture)), picture)
    single = picture.astype(np.float32) * 2
    np.testing.assert_array_equal(decode(encode(single)), single)


@pytest.mark.parametrize("dtype", [np.float16, np.float32])
def test_strided_pictures(dtype: type) -> None:
    whole = NOISE.astype(dtype)
    for picture in (whole[::2, 1::3], whole[..., ::-1], whole.transpose(1, 0, 2), whole[::-1]):
        assert not picture.flags.c_contiguous
        np.testing.assert_array_equal(decode(encode(picture)), picture)


def test_foreign_channels_and_windows() -> None:
    red, green, blue, alpha = np.random.default_rng(1).random((4, 5, 7)).astype(np.float32)
    color = {"R": red, "G": green, "B": blue}
    expected = np.stack((red, green, blue), axis=-1)
    np.testing.assert_array_equal(decode(library_bytes(color)), expected)
    np.testing.assert_array_equal(decode(library_bytes(color | {"A": alpha})), expected)
    windows = {
        "dataWindow": (np.array([3, -2], np.int32), np.array([9, 2], np.int32)),
        "displayWindow": (np.array([0, 0], np.int32), np.array([99, 99], np.int32)),
    }
    shifted = library_bytes(color, **windows)
    assert read_size(shifted) == (5, 7)
    np.testing.assert_array_equal(decode(shifted), expected)
    mixed = decode(library_bytes(color | {"R": red.astype(np.float16)}))
    assert mixed.dtype == np.float32
    np.testing.assert_array_equal(mixed[..., 1:], expected[..., 1:])
    np.testing.assert_array_equal(mixed[..., 0], red.astype(np.float16))


def test_grey() -> None:
    grey = NOISE[..., 0].astype(np.float16)
    found = decode(library_bytes({"Y": grey}))
    assert found.dtype == np.float16
    np.testing.assert_array_equal(found, np.repeat(grey[..., None], 3, axis=-1))


def parts_bytes(*parts: tuple[str, dict[str, np.ndarray]]) -> bytes:
    """A file of several named parts."""
    corner = (np.array([0, 0], np.int32), np.array([99, 99], np.int32))
    header = {"type": OpenEXR.scanlineimage, "displayWindow": corner}
    buffer = io.BytesIO()
    OpenEXR.File([OpenEXR.Part(dict(header), dict(one), name) for name, one in parts]).write(buffer)
    return buffer.getvalue()


COLOUR = np.random.default_rng(3).random((4, 5, 3)).astype(np.float16)
OTHER = np.ones((4, 5), np.float32)


def channels(names: str, prefix: str = "", picture: np.ndarray = COLOUR) -> dict[str, np.ndarray]:
    return {prefix + name: picture[..., i].copy() for i, name in enumerate(names)}


@pytest.mark.parametrize(
    "payload",
    [
        library_bytes(channels("rgb")),
        library_bytes(channels("RGB") | channels("rgb", picture=COLOUR / 2)),
        library_bytes(channels("RGB") | channels("RGB", "ViewLayer.Combined.", COLOUR / 2)),
        library_bytes(channels("RGB", "ViewLayer.Combined.") | {"ViewLayer.Depth.Z": OTHER}),
        library_bytes(channels("RGB", "a.Combined.") | channels("RGB", "a.Diffuse.", COLOUR / 2)),
        library_bytes(channels("RGB", "beauty.") | channels("XYZ", "normal.", COLOUR / 2)),
        library_bytes(channels("RGB") | channels("XYZ", picture=COLOUR / 2)),
        parts_bytes(("depth", {"Z": OTHER[:3]}), ("beauty", channels("RGB"))),
        parts_bytes(("grey", {"Y": OTHER}), ("beauty", channels("RGB", "layer."))),
        parts_bytes(("a", channels("RGB")), ("b", channels("RGB", picture=COLOUR / 2))),
    ],
    ids=["lower", "both", "bare", "layer", "combined", "normals", "xyz", "part", "grey", "first"],
)
def test_the_colour_is_found(payload: bytes) -> None:
    found = decode(payload)
    assert found.dtype == np.float16 and read_size(payload) == (4, 5)
    np.testing.assert_array_equal(found, COLOUR)


def test_of_several_colours_none_is_guessed() -> None:
    layers = channels("RGB", "diffuse.") | channels("RGB", "glossy.")
    with pytest.raises(ValueError, match="layers diffuse, glossy all hold a colour; expected one"):
        decode(library_bytes(layers))
    parts = parts_bytes(*((name, channels("RGB", "x.")) for name in ("left", "right")))
    with pytest.raises(ValueError, match=r"layers left\.x, right\.x all hold a colour"):
        decode(parts)


def test_xyz_becomes_linear_srgb() -> None:
    rgb = np.random.default_rng(4).random((4, 5, 3))
    xyz = rgb2xyz(np.where(rgb <= 0.0031308, rgb * 12.92, 1.055 * rgb ** (1 / 2.4) - 0.055))
    # scikit-image has another last digit of the white.
    for dtype, error in ((np.float32, 5e-4), (np.float16, 3e-3)):
        found = decode(library_bytes(channels("XYZ", picture=xyz.astype(dtype))))
        assert found.dtype == dtype
        np.testing.assert_allclose(found, rgb, atol=error)
    saturated = np.broadcast_to([0.0, 0.5, 0.0], (4, 5, 3)).astype(np.float32)
    assert (decode(library_bytes(channels("XYZ", picture=saturated)))[..., 0] < 0).all()


# x and y of red, green, blue and white, and the matrices to Rec.709 by Bradford's adaptation: those
# of the ACES project (AP0, AP1), and of ITU-R BT.2087 (Rec.2020).
AP0 = (0.7347, 0.2653, 0.0, 1.0, 0.0001, -0.077, 0.32168, 0.33767)
AP1 = (0.713, 0.293, 0.165, 0.83, 0.128, 0.044, 0.32168, 0.33767)
REC2020 = (0.708, 0.292, 0.17, 0.797, 0.131, 0.046, 0.3127, 0.329)
REC709_OF = {
    AP0: [[2.5217, -1.1341, -0.3876], [-0.2765, 1.3727, -0.0962], [-0.0154, -0.1530, 1.1684]],
    AP1: [[1.7051, -0.6218, -0.0833], [-0.1303, 1.1408, -0.0105], [-0.0240, -0.1290, 1.1530]],
    REC2020: [[1.6605, -0.5876, -0.0728], [-0.1246, 1.1329, -0.0083], [-0.0182, -0.1006, 1.1187]],
}


@pytest.mark.parametrize("named", list(REC709_OF), ids=["AP0", "AP1", "wide gamut"])
def test_other_primaries_become_those_of_rec709(named: tuple[float, ...]) -> None:
    picture = np.stack((NOISE[:4, :5, 0], NOISE[:4, :5, 1], NOISE[:4, :5, 2]), axis=-1)
    picture[0, 0] = 1.0
    found = decode(library_bytes(channels("RGB", picture=picture), chromaticities=named))
    np.testing.assert_allclose(found, picture @ np.array(REC709_OF[named]).T, atol=2e-4)
    np.testing.assert_allclose(found[0, 0], 1.0, atol=1e-5)  # white stays white
    grey = library_bytes({"Y": NOISE[..., 0].copy()}, chromaticities=named)
    np.testing.assert_array_equal(decode(grey)[..., 2], NOISE[..., 0])


def test_half_floats_of_other_primaries_that_leave_their_range_become_floats() -> None:
    picture = np.full((4, 5, 3), [60000, 0, 0], np.float16)
    found = decode(library_bytes(channels("RGB", picture=picture), chromaticities=AP0))
    assert found.dtype == np.float32 and found[0, 0, 0] > 150_000
    dim = decode(library_bytes(channels("RGB"), chromaticities=AP0))
    assert dim.dtype == np.float16


def test_primaries_of_rec709_change_no_bit_and_such_as_span_nothing_are_refused() -> None:
    rounded = (0.64, 0.33, 0.3, 0.6, 0.15, 0.06, 0.3127, 0.329)
    payload = library_bytes(channels("RGB"), chromaticities=rounded)
    np.testing.assert_array_equal(decode(payload), COLOUR)
    with pytest.raises(ValueError, match="its chromaticities 0, 0, .* span no colours"):
        decode(library_bytes(channels("RGB"), chromaticities=(0.0,) * 8))


def test_channels_that_are_no_colour() -> None:
    plane = NOISE[..., 0].copy()
    for channels, message in (
        ({"Z": plane}, "channels are Z; expected R, G and B"),
        ({"R": plane, "G": plane}, "channels are G, R; expected"),
        ({"Y": plane, "RY": plane, "BY": plane}, "channels are BY, RY, Y; expected"),
        ({"X": plane, "Y": plane}, "channels are X, Y; expected"),
        ({"n.X": plane, "n.Y": plane, "n.Z": plane}, "channels are n.X, n.Y, n.Z; expected"),
        (
            {name: plane.astype(np.uint32) for name in "RGB"},
            r"channel R holds whole numbers \(UINT\)",
        ),
    ):
        with pytest.raises(UnsuitableError, match=message):
            decode(library_bytes(channels))


def test_every_truncation_is_told() -> None:
    payload = encode(NOISE[:17, :4])  # two chunks
    for length in range(len(payload)):
        with pytest.raises(ValueError):
            decode(payload[:length])
    with pytest.raises(ValueError, match="truncated"):
        decode(payload[:-1])


def test_sizes_are_checked_before_there_is_room_for_them() -> None:
    payload = encode(np.zeros((20, 24, 3), dtype=np.float16))
    window = struct.pack("<4i", 0, 0, 23, 19)
    assert payload.count(window) == 2  # data and display
    for (width, height), message in (
        ((8000, 8000), "cannot hold 8000 x 8000"),
        ((20_000, 20_000), "size is 20000 x 20000"),
    ):
        bomb = payload.replace(window, struct.pack("<4i", 0, 0, width - 1, height - 1))
        with pytest.raises(ValueError, match=message):
            decode(bomb)
    for last in ((-1, 19), (2**31 - 1, 2**31 - 1)):
        with pytest.raises(ValueError):
            read_size(payload.replace(window, struct.pack("<4i", 0, 0, *last)))


@settings(max_examples=300)
@given(st.lists(st.tuples(st.integers(0, 5000), st.integers(0, 255)), min_size=1, max_size=4))
def test_changed_bytes_raise_or_read(changes: list[tuple[int, int]]) -> None:
    payload = bytearray(encode(NOISE[:17, :4]))
    for position, value in changes:
        payload[position % len(payload)] = value
    try:
        picture = decode(bytes(payload))
    except ValueError:
        return
    assert picture.dtype in (np.float16, np.float32) and picture.shape[2] == 3


def test_pictures_that_are_no_colour() -> None:
    assert not openexr.accepts(b"#?RADIANCE\n") and not openexr.accepts(b"")
    for picture in (NOISE[..., :2], NOISE[0], NOISE[:0], NOISE.astype(np.float64)):
        with pytest.raises(ValueError, match="values have"):
            encode(picture)
    for payload in (b"", b"not a picture", openexr.MAGIC):
        with pytest.raises(ValueError, match="OpenEXR"):
            decode(payload)
