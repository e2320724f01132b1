"""OpenEXR pictures (.exr): half or single floats, kept bit for bit.

Its channels are R, G and B, or Y alone for grey, of the first part; other channels and the display
window are ignored. The OpenEXR library reads and writes it in memory.
"""

from __future__ import annotations

import io
from typing import Any

import numpy as np
import OpenEXR

from ..codes import Expansion, FloatExpansion

TITLE = "OpenEXR"
SUFFIXES = (".exr",)
HDR = True
MAGIC = b"\x76\x2f\x31\x01"
COLOR = ("R", "G", "B")
LUMINANCE = "Y"
CHROMA = ("RY", "BY")
FLOAT_TYPES = (np.dtype(np.float16), np.dtype(np.float32))
MAX_PIXELS = 1 << 28
# The library allocates memory by the header, before it reads pixels. Deflate expands a byte to at
# most 1032 bytes, and a wavelet of a uniform picture expands it hardly more.
MAX_PIXELS_PER_BYTE = 1 << 12


def accepts(head: bytes) -> bool:
    """Whether a file that starts with these bytes is an OpenEXR picture."""
    return head.startswith(MAGIC)


def read_size(payload: bytes) -> tuple[int, int]:
    """The (height, width) of the data window, from the header.

    Raises:
        ValueError: the header is malformed.
    """
    first, last = _open(payload, header_only=True).header()["dataWindow"]
    width, height = (int(b) - int(a) + 1 for a, b in zip(first, last, strict=True))
    if height < 1 or width < 1 or height * width > MAX_PIXELS:
        raise ValueError(f"its size is {width} x {height}; expected 1 to {MAX_PIXELS} pixels")
    return height, width


def decode(payload: bytes) -> np.ndarray:
    """Values `[H, W, 3]` of a picture, float16 if all its channels are HALF, else float32.

    Raises:
        ValueError: the picture is malformed or truncated, or has no colour channels of floats.
    """
    size = read_size(payload)
    if size[0] * size[1] > len(payload) * MAX_PIXELS_PER_BYTE:
        raise ValueError(f"it is truncated: {len(payload)} bytes cannot hold {size[1]} x {size[0]}")
    channels = _open(payload, separate_channels=True).channels()
    names = _color_names(channels)
    planes = [_plane(channels[name], name, size) for name in names]
    # Planes of float16 and float32 are stacked to float32.
    return np.stack(planes if len(planes) == 3 else planes * 3, axis=-1)


def expansion(gamma: float) -> Expansion:
    """The expansion of codes, which are linear values already."""
    return FloatExpansion()


def encode(picture: np.ndarray) -> bytes:
    """An OpenEXR file of values `[H, W, 3]`: HALF of float16, FLOAT of float32, ZIP compression.

    Raises:
        ValueError: the shape or type is another one.
    """
    if picture.ndim != 3 or picture.shape[2] != 3 or 0 in picture.shape:
        raise ValueError(f"values have shape {list(picture.shape)}; expected [H, W, 3]")
    if picture.dtype not in FLOAT_TYPES:
        raise ValueError(f"values have type {picture.dtype}; expected float16 or float32")
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    # The library writes strided arrays wrongly, without an error.
    file = OpenEXR.File(header, {"RGB": np.ascontiguousarray(picture)})
    buffer = io.BytesIO()
    file.write(buffer)
    return buffer.getvalue()


def _open(payload: bytes, **options: bool) -> OpenEXR.File:
    """The file as the library opens it, with at least one part."""
    try:
        file = OpenEXR.File(io.BytesIO(payload), **options)
    except (RuntimeError, ValueError, TypeError) as error:
        raise ValueError(f"OpenEXR: {error}") from error
    # The library reports unreadable pixels by a file without parts.
    if not file.parts:
        raise ValueError("it is truncated or damaged")
    return file


def _color_names(channels: dict[str, Any]) -> tuple[str, ...]:
    """The names of the channels that hold the colour."""
    if all(name in channels for name in COLOR):
        return COLOR
    if LUMINANCE in channels and not any(name in channels for name in CHROMA):
        return (LUMINANCE,)
    found = ", ".join(sorted(channels)) or "none"
    raise ValueError(f"its channels are {found}; expected R, G and B, or Y alone")


def _plane(channel: OpenEXR.Channel, name: str, size: tuple[int, int]) -> np.ndarray:
    """The pixels `[H, W]` of one channel."""
    pixels = channel.pixels
    if not isinstance(pixels, np.ndarray) or pixels.dtype not in FLOAT_TYPES:
        raise ValueError(f"its channel {name} holds no floats; expected HALF or FLOAT")
    if pixels.shape != size:
        raise ValueError(f"its channel {name} is {pixels.shape}; expected {size}")
    return pixels
