"""TIFF in every depth, layout and compression, as tifffile writes it."""

from __future__ import annotations

import io

import numpy as np
import pytest
import tifffile
from hypothesis import given, settings
from hypothesis import strategies as st

from spmm_torch.data.codecs import DECODE_ERRORS, codec_of, tiff
from spmm_torch.data.codecs.arrangement import ORIENTATION_TAG, upright

RNG = np.random.default_rng(0)
WORDS = RNG.integers(0, 65536, (16, 32, 4), dtype=np.uint16)
FLOATS = RNG.gamma(1.0, 2.0, (16, 32, 3)).astype(np.float32)
RGB = {"photometric": "rgb"}


def saved(codes: np.ndarray, **options: object) -> bytes:
    """A file as tifffile writes it."""
    buffer = io.BytesIO()
    tifffile.imwrite(buffer, codes, **options)
    return buffer.getvalue()


def opaque(codes: np.ndarray) -> np.ndarray:
    codes = codes.copy()
    codes[..., -1] = 65535
    return codes


@pytest.mark.parametrize(
    "options",
    [
        {},
        {"byteorder": ">"},
        {"bigtiff": True},
        {"compression": "lzw", "predictor": True},
        {"compression": "deflate"},
        {"compression": "packbits"},
        {"tile": (16, 16), "compression": "zlib"},
        {"rowsperstrip": 5},
        {"planarconfig": "separate"},
    ],
    ids=lambda options: " ".join(options) or "plain",
)
@pytest.mark.parametrize("dtype", [np.uint16, np.float16, np.float32])
def test_colour_in_full_depth(options: dict, dtype: type) -> None:
    codes = WORDS[..., :3] if dtype is np.uint16 else FLOATS.astype(dtype)
    planes = np.moveaxis(codes, -1, 0) if "planarconfig" in options else codes
    payload = saved(planes, **RGB, **options)
    assert codec_of(payload) is tiff
    found = tiff.decode(payload)
    assert found.dtype == dtype and found.dtype.isnative and found.flags.c_contiguous
    np.testing.assert_array_equal(found, codes)


def test_grey_alpha_and_doubles() -> None:
    grey = WORDS[..., [0, 0, 0]]
    for payload, expected in (
        (saved(WORDS[..., 0]), grey),
        (saved(FLOATS[..., 0]), FLOATS[..., [0, 0, 0]]),
        (saved(WORDS[..., 0], photometric="miniswhite"), 65535 - grey),
        (saved(opaque(WORDS), extrasamples=["unassalpha"], **RGB), WORDS[..., :3]),
        (saved(WORDS, extrasamples=["unspecified"], **RGB), WORDS[..., :3]),
        (saved(FLOATS.astype(np.float64), **RGB), FLOATS),
        (saved((WORDS[..., :3] >> 8).astype(np.uint8), **RGB), WORDS[..., :3] >> 8),
        (  # which Pillow does not know
            saved((WORDS[..., :3] >> 8).astype(np.uint8), bigtiff=True, byteorder=">", **RGB),
            (WORDS[..., :3] >> 8) * 257,
        ),
    ):
        np.testing.assert_array_equal(tiff.decode(payload), expected)
    transparent = saved(WORDS, extrasamples=["unassalpha"], **RGB)
    np.testing.assert_array_equal(tiff.decode(transparent, ignore_alpha=True), WORDS[..., :3])


@pytest.mark.parametrize("orientation", range(1, 9))
def test_the_orientation_tag_is_obeyed(orientation: int) -> None:
    for codes in (WORDS[..., :3], (WORDS[..., :3] >> 8).astype(np.uint8)):
        tag = (ORIENTATION_TAG, 3, 1, orientation, True)
        found = tiff.decode(saved(codes, extratags=[tag], **RGB))
        np.testing.assert_array_equal(found, upright(codes, orientation))


@pytest.mark.parametrize(
    ("payload", "message"),
    [
        (saved(WORDS[..., 0].astype(np.uint32)), "32-bit uint32 numbers, whose white is not known"),
        (saved(WORDS[..., 0].astype(np.int32)), "32-bit int32 numbers, whose white is not known"),
        (saved(WORDS[..., 0].astype(np.int16)), "16-bit int16 numbers, whose white is not known"),
        (saved(WORDS, extrasamples=["unassalpha"], **RGB), "transparent in places"),
        (saved(np.stack([WORDS[..., :3]] * 2), **RGB), "holds 2 pictures; expected one"),
        (saved(np.stack([WORDS[..., :3] >> 8] * 2).astype(np.uint8), **RGB), "holds 2 pictures"),
        (saved(WORDS, photometric="separated"), "SEPARATED; expected grey or RGB"),
        (saved(np.tile(WORDS, 2), **RGB), "8 channels; expected grey or RGB"),
        (saved(FLOATS[..., 0], photometric="miniswhite"), "floats of which 0 is white"),
    ],
    ids=lambda value: "" if isinstance(value, bytes) else value,
)
def test_what_is_not_certain_is_refused(payload: bytes, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        tiff.decode(payload)


SMALL = [saved(WORDS[:5, :6, :3], **RGB, **one) for one in ({}, {"compression": "lzw"})]
SMALL.append(saved((WORDS[:5, :6, 0] >> 8).astype(np.uint8)))


@pytest.mark.parametrize("payload", SMALL, ids=["plain", "lzw", "8 bits"])
def test_every_truncation_is_told(payload: bytes) -> None:
    for length in range(0, len(payload), 3):
        with pytest.raises(DECODE_ERRORS):
            codec_of(payload).decode(payload[:length])


@settings(max_examples=150)
@given(st.lists(st.tuples(st.integers(0, 500), st.integers(0, 255)), min_size=1, max_size=4))
def test_changed_bytes_raise_or_read(changes: list[tuple[int, int]]) -> None:
    payload = bytearray(SMALL[1])
    for position, value in changes:
        payload[position % len(payload)] = value
    try:
        codes = tiff.decode(bytes(payload))
    except DECODE_ERRORS:
        return
    assert codes.shape[2] == 3
