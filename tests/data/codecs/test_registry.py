"""What every codec of the registry holds to."""

from __future__ import annotations

import io
from collections.abc import Callable

import numpy as np
import pytest
import torch
from PIL import Image

from spmm_torch.data.codecs import (
    CODECS,
    DECODE_ERRORS,
    SUFFIXES,
    Codec,
    codec_of,
    openexr,
    pillow,
    radiance,
)

ALL = [pytest.param(codec, id=codec.TITLE) for codec in CODECS]
VALUES = np.random.default_rng(1).random((4, 9, 3), dtype=np.float32)


def png(values: np.ndarray) -> bytes:
    """8-bit codes of values from 0 to 1, without a gamma."""
    buffer = io.BytesIO()
    Image.fromarray(np.rint(values * 255).astype(np.uint8)).save(buffer, "PNG")
    return buffer.getvalue()


ENCODERS: dict[str, Callable[[np.ndarray], bytes]] = {
    openexr.TITLE: openexr.encode,
    radiance.TITLE: lambda values: radiance.encode(radiance.float_to_rgbe(values)),
    pillow.TITLE: png,
}


@pytest.mark.parametrize("codec", ALL)
def test_names(codec: Codec) -> None:
    assert codec.TITLE and codec.SUFFIXES
    assert all(suffix.startswith(".") and suffix.islower() for suffix in codec.SUFFIXES)


def test_no_two_codecs_share_a_suffix() -> None:
    assert len(set(SUFFIXES)) == len(SUFFIXES)


def test_only_the_last_one_takes_everything() -> None:
    """Whatever comes behind it would never be asked."""
    assert CODECS[-1] is pillow
    assert not any(codec.accepts(b"") or codec.accepts(b"unlike any") for codec in CODECS[:-1])


@pytest.mark.parametrize("codec", ALL)
@pytest.mark.parametrize("payload", [b"", b"unlike any picture"], ids=["empty", "foreign"])
def test_what_is_no_picture_is_refused(codec: Codec, payload: bytes) -> None:
    with pytest.raises(DECODE_ERRORS):
        codec.decode(payload)


@pytest.mark.parametrize("title", ENCODERS)
def test_the_first_bytes_tell_the_codec_and_values_come_back(title: str) -> None:
    payload = ENCODERS[title](VALUES)
    codec = codec_of(payload)
    assert title == codec.TITLE
    codes = codec.decode(payload)
    values = codec.expansion(1.0)(torch.from_numpy(codes.copy()))
    assert values.dtype == torch.float32
    np.testing.assert_allclose(values.numpy(), VALUES, atol=0.5 / 127)


@pytest.mark.parametrize("title", ENCODERS)
def test_a_truncated_picture_is_refused(title: str) -> None:
    payload = ENCODERS[title](VALUES)
    with pytest.raises(DECODE_ERRORS):
        codec_of(payload).decode(payload[: len(payload) // 2])


def test_gamma_concerns_display_encoded_pictures_only() -> None:
    for title, encode in ENCODERS.items():
        codec = codec_of(encode(VALUES))
        codes = torch.from_numpy(codec.decode(encode(VALUES)).copy())
        same = torch.equal(codec.expansion(1.0)(codes), codec.expansion(2.2)(codes))
        assert same == (title != pillow.TITLE)
        assert same == codec.HDR
