"""JPEG, PNG and their kin in full depth and upright, against Pillow, imagecodecs and formulas."""

from __future__ import annotations

import io
import zlib

import imagecodecs
import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image, ImageOps
from PIL.PngImagePlugin import PngInfo

from spmm_torch.data.codecs import DECODE_ERRORS, UnsuitableError, codec_of, pillow, tiff
from spmm_torch.data.codecs.arrangement import ORIENTATION_TAG

RNG = np.random.default_rng(0)
BYTES = RNG.integers(0, 256, (4, 6, 4), dtype=np.uint8)
WORDS = RNG.integers(0, 65536, (4, 6, 4), dtype=np.uint16)
GREY = [0, 0, 0]
RGB = [0, 1, 2]


def saved(picture: np.ndarray | Image.Image, kind: str, **options: object) -> bytes:
    """A file as Pillow writes it."""
    image = picture if isinstance(picture, Image.Image) else Image.fromarray(picture)
    buffer = io.BytesIO()
    image.save(buffer, kind, **options)
    return buffer.getvalue()


def png(codes: np.ndarray) -> bytes:
    """A PNG at the depth of the codes."""
    return imagecodecs.png_encode(np.ascontiguousarray(codes))


def opaque(codes: np.ndarray) -> np.ndarray:
    codes = codes.copy()
    codes[..., -1] = np.iinfo(codes.dtype).max
    return codes


def netpbm(codes: np.ndarray, largest: int, plain: bool = False) -> bytes:
    """A PPM or PGM, with a comment in its header."""
    magic = (2 if plain else 5) + (codes.shape[-1] == 3)
    header = f"P{magic}\n# made by hand\n{codes.shape[1]} {codes.shape[0]}\n{largest}\n".encode()
    words = "\n# a remark\n".join(" ".join(map(str, row.ravel())) for row in codes)
    return header + (words.encode() if plain else codes.astype(">u2").tobytes())


@pytest.mark.parametrize(
    ("payload", "expected"),
    [
        (png(WORDS[..., 0]), WORDS[..., GREY]),
        (png(opaque(WORDS[..., :2])), WORDS[..., GREY]),
        (png(WORDS[..., :3]), WORDS[..., RGB]),
        (png(opaque(WORDS)), WORDS[..., RGB]),
        (netpbm(WORDS[..., :3], 65535), WORDS[..., RGB]),
        (netpbm(WORDS[..., :1], 65535), WORDS[..., GREY]),
        (netpbm(WORDS[..., :3], 65535, plain=True), WORDS[..., RGB]),
        (netpbm(WORDS[..., :1], 65535, plain=True), WORDS[..., GREY]),
        (netpbm(WORDS[..., :3] % 1024, 1023), np.rint(WORDS[..., RGB] % 1024 * (65535 / 1023))),
    ],
    ids=["png", "png la", "png rgb", "png rgba", "p6", "p5", "p3", "p2", "10 bits"],
)
def test_sixteen_bits_are_kept(payload: bytes, expected: np.ndarray) -> None:
    assert codec_of(payload) is pillow
    found = pillow.decode(payload)
    assert found.dtype == np.uint16
    np.testing.assert_array_equal(found, expected)
    values = pillow.expansion(1.0)(torch.from_numpy(found))
    np.testing.assert_allclose(values, expected / 65535, rtol=1e-7)


PALETTE = Image.fromarray(BYTES[..., :3]).quantize(8)
FEW = np.asarray(PALETTE.convert("RGB"))


@pytest.mark.parametrize(
    ("payload", "expected"),
    [
        (saved(BYTES[..., 0], "PNG"), BYTES[..., GREY]),
        (saved(Image.fromarray(opaque(BYTES[..., :2]), "LA"), "PNG"), BYTES[..., GREY]),
        (saved(opaque(BYTES), "PNG"), BYTES[..., RGB]),
        (saved(PALETTE, "PNG"), FEW),
        (saved(BYTES[..., 0] > 127, "PNG"), (BYTES[..., GREY] > 127) * 255),
        (saved(opaque(BYTES), "WEBP", lossless=True), BYTES[..., RGB]),
        (saved(BYTES[..., :3], "TGA"), BYTES[..., RGB]),
        (saved(opaque(BYTES), "TGA", compression="tga_rle"), BYTES[..., RGB]),
        (saved(BYTES[..., :3], "BMP"), BYTES[..., RGB]),
        (saved(BYTES[..., :3], "PPM"), BYTES[..., RGB]),
        (saved(opaque(BYTES), "TIFF", compression="tiff_lzw"), BYTES[..., RGB]),
        (saved(PALETTE, "TIFF"), FEW),
    ],
    ids=lambda value: "",
)
def test_eight_bits_of_every_arrangement(payload: bytes, expected: np.ndarray) -> None:
    found = codec_of(payload).decode(payload)
    assert found.dtype == np.uint8
    np.testing.assert_array_equal(found, expected)


def oriented(kind: str, orientation: int) -> bytes:
    """A file that says how it was held."""
    exif = Image.Exif()
    exif[ORIENTATION_TAG] = orientation
    options = {"quality": 100} if kind == "JPEG" else {"lossless": True} if kind == "WEBP" else {}
    return saved(BYTES[..., :3], kind, exif=exif, **options)


@pytest.mark.parametrize("orientation", range(9))
@pytest.mark.parametrize("kind", ["JPEG", "PNG", "WEBP", "TIFF"])
def test_the_orientation_tag_is_obeyed(kind: str, orientation: int) -> None:
    payload = oriented(kind, orientation)
    with Image.open(io.BytesIO(payload)) as image:
        expected = np.asarray(ImageOps.exif_transpose(image))
    assert expected.shape == ((6, 4, 3) if orientation >= 5 else (4, 6, 3))
    found = codec_of(payload).decode(payload)
    assert found.flags.c_contiguous
    np.testing.assert_array_equal(found, expected)


def test_a_png_of_16_bits_obeys_it_too() -> None:
    tag = oriented("PNG", 6)
    start = tag.index(b"eXIf") - 4
    chunk = tag[start : start + 12 + int.from_bytes(tag[start : start + 4], "big")]
    plain = png(WORDS[..., :3])
    for before in (b"IDAT", b"IEND"):
        place = plain.index(before) - 4
        found = pillow.decode(plain[:place] + chunk + plain[place:])
        np.testing.assert_array_equal(found, np.rot90(WORDS[..., :3], -1))


@pytest.mark.parametrize(
    ("payload", "message"),
    [
        (saved(BYTES, "PNG"), "transparent in places"),
        (saved(PALETTE, "PNG", transparency=0), "transparent in places"),
        (png(WORDS), "transparent in places"),
        (png(WORDS[..., :2]), "transparent in places"),
        (saved(Image.new("CMYK", (6, 4)), "JPEG"), "mode CMYK instead of RGB or grey"),
        (
            saved(BYTES, "PNG", save_all=True, append_images=[Image.fromarray(255 - BYTES)]),
            "several pictures",
        ),
        (netpbm(WORDS[..., :3], 65535)[:-1], "truncated: 71 of 72 codes"),
        (netpbm(WORDS[..., :3], 300), "holds codes from"),
        (netpbm(WORDS[..., :3], 300, plain=True), "holds codes from"),
        (
            netpbm(WORDS[..., :3], 65535, True).replace(b"# a remark", b"-1"),
            "holds codes from -1",
        ),
        (saved(BYTES, "GIF"), "cannot identify its format; expected JPEG, PNG"),
    ],
    ids=lambda value: "" if isinstance(value, bytes) else value,
)
def test_what_is_not_certain_is_refused(payload: bytes, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        pillow.decode(payload)


def test_transparency_is_ignored_where_asked() -> None:
    for codes in (BYTES, WORDS):
        payload = png(codes)
        np.testing.assert_array_equal(pillow.decode(payload, ignore_alpha=True), codes[..., :3])


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"version https://git-lfs.github.com/spec/v1\n", "it is a pointer of Git LFS"),
        (b"<html>not found</html>", "it is a web page"),
    ],
)
def test_a_file_in_the_place_of_a_picture_is_named(content: bytes, message: str) -> None:
    with pytest.raises(UnsuitableError, match=message):
        pillow.decode(content)


def test_too_many_pixels_are_told_with_what_to_do(monkeypatch: pytest.MonkeyPatch) -> None:
    payload = saved(Image.new("RGB", (6, 5)), "PNG")
    monkeypatch.setattr(Image, "MAX_IMAGE_PIXELS", 14)  # Pillow refuses twice as many
    with pytest.raises(
        UnsuitableError, match="more pixels than Pillow opens, 28; .* scale it down"
    ):
        pillow.decode(payload)


@pytest.mark.parametrize("kind", ["text", "text after the pixels", "profile"])
def test_a_png_with_large_notes_is_read(kind: str) -> None:
    """As of programs that keep their whole scene in it [Pillow issues 2445 and 8363]."""
    pixels = RNG.integers(0, 256, (4, 6, 3), dtype=np.uint8)
    notes, buffer = PngInfo(), io.BytesIO()
    if kind != "profile":
        notes.add(b"zTXt", b"scene\0\0" + zlib.compress(bytes(3_000_000)), kind != "text")
    profile = bytes(3_000_000) if kind == "profile" else None
    Image.fromarray(pixels).save(buffer, "PNG", pnginfo=notes, icc_profile=profile)
    np.testing.assert_array_equal(pillow.decode(buffer.getvalue()), pixels)


NOISE = png(RNG.integers(0, 65536, (9, 7, 3), dtype=np.uint16))


def test_every_truncation_of_16_bits_is_told() -> None:
    for length in range(len(NOISE) - 12):  # the last chunk holds nothing
        with pytest.raises(DECODE_ERRORS):
            pillow.decode(NOISE[:length])


@settings(max_examples=150)
@given(st.lists(st.tuples(st.integers(8, 500), st.integers(0, 255)), min_size=1, max_size=4))
def test_changed_bytes_raise_or_read(changes: list[tuple[int, int]]) -> None:
    payload = bytearray(NOISE)
    for position, value in changes:
        payload[position % len(payload)] = value
    try:
        codes = pillow.decode(bytes(payload))
    except DECODE_ERRORS:
        return
    assert codes.dtype in (np.uint8, np.uint16) and codes.shape[2] == 3


def test_formats_share_no_suffix() -> None:
    assert {".tif", ".tiff"} == set(tiff.SUFFIXES)
    assert {".webp", ".jfif", ".jpe", ".tga", ".pgm"} < set(pillow.SUFFIXES)
