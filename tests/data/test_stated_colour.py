"""Pictures that state other colours than they are read with are no secret."""

from __future__ import annotations

import io
import struct
import zlib
from pathlib import Path

import numpy as np
import pytest
from PIL import Image, ImageCms

from spmm_torch import load_btf
from spmm_torch.data.stated_colour import colour_notes

LINEAR, USUAL = 100000, 45455  # gAMA of a gamma of 1 and of 2.2
PIXELS = np.arange(4 * 4 * 3, dtype=np.uint8).reshape(4, 4, 3)


def png(gamma: int | None = None, srgb: bool = False) -> bytes:
    """A PNG with chunks of its colours right before its pixels."""
    buffer = io.BytesIO()
    Image.fromarray(PIXELS).save(buffer, "PNG")
    plain = buffer.getvalue()
    chunks = b""
    if gamma is not None:
        chunks += chunk(b"gAMA", struct.pack(">I", gamma))
    if srgb:
        chunks += chunk(b"sRGB", b"\0")
    return plain[:33] + chunks + plain[33:]


def chunk(kind: bytes, content: bytes) -> bytes:
    body = kind + content
    return struct.pack(">I", len(content)) + body + struct.pack(">I", zlib.crc32(body))


def profiled(space: str, format: str) -> bytes:
    buffer = io.BytesIO()
    profile = ImageCms.ImageCmsProfile(ImageCms.createProfile(space)).tobytes()
    Image.fromarray(PIXELS).save(buffer, format, icc_profile=profile)
    return buffer.getvalue()


@pytest.mark.parametrize(
    ("payload", "gamma"),
    [
        (png(), 2.2),
        (png(USUAL), 2.2),
        (png(LINEAR), 1.0),
        (png(LINEAR, srgb=True), 2.2),  # sRGB goes before
        (png(0), 2.2),  # states nothing
        (profiled("sRGB", "JPEG"), 2.2),
        (b"no picture", 2.2),
        (png(LINEAR)[:40], 2.2),
    ],
)
def test_what_agrees_is_not_told(payload: bytes, gamma: float) -> None:
    assert colour_notes(payload, gamma) == ()


@pytest.mark.parametrize("format", ["JPEG", "PNG", "WEBP", "TIFF"])
def test_another_profile_is_named(format: str) -> None:
    (note,) = colour_notes(profiled("XYZ", format), 2.2)
    assert note.startswith("note: pictures have the colour profile 'XYZ")


def test_another_gamma_is_told_with_what_to_do(tmp_path: Path) -> None:
    (tmp_path / "tl000 pl000 tv000 pv000.png").write_bytes(png(LINEAR))
    expected = "note: pictures state a gamma of 1, and are read with 2.2: data.gamma=1 follows them"
    assert expected in load_btf(tmp_path).notes
    assert expected not in load_btf(tmp_path, gamma=1.0).notes
