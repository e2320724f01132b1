"""OpenEXR pictures (.exr): half or single floats, kept bit for bit.

`exr_layers.py` finds the channels of the colour. X, Y and Z become linear sRGB, Y alone is grey;
other channels are ignored, and so is what the display window has beyond the pixels. The OpenEXR
library reads and writes in memory.
"""

from __future__ import annotations

import io
from typing import TYPE_CHECKING, Any

import numpy as np

from ..codes import Expansion, FloatExpansion
from .exr_layers import Layer, find_layer

if TYPE_CHECKING:
    import OpenEXR

TITLE = "OpenEXR"
SUFFIXES = (".exr",)
HDR = True
MAGIC = b"\x76\x2f\x31\x01"
FLOAT_TYPES = (np.dtype(np.float16), np.dtype(np.float32))
MAX_PIXELS = 1 << 28
# The library allocates memory by the header, before it reads pixels. Deflate expands a byte to at
# most 1032 bytes, and a wavelet of a uniform picture expands it hardly more.
MAX_PIXELS_PER_BYTE = 1 << 12
# From XYZ, of which the white D65 has Y = 1, to linear sRGB [IEC 61966-2-1].
SRGB_OF_XYZ = np.array(
    [[3.2406, -1.5372, -0.4986], [-0.9689, 1.8758, 0.0415], [0.0557, -0.2040, 1.0570]]
)


def accepts(head: bytes) -> bool:
    """Whether a file that starts with these bytes is an OpenEXR picture."""
    return head.startswith(MAGIC)


def read_size(payload: bytes) -> tuple[int, int]:
    """The (height, width) of the data window of the colour, from the header.

    Raises:
        ValueError: the header is malformed, or has no colour channels.
    """
    return _read_header(payload)[1]


def decode(payload: bytes, ignore_alpha: bool = False) -> np.ndarray:
    """Values `[H, W, 3]` of a picture, float16 if all its channels are HALF, else float32.

    Raises:
        ValueError: the picture is malformed or truncated, or has no colour channels of floats, or
            several of them.
    """
    layer, size = _read_header(payload)
    channels = _open(payload, separate_channels=True).parts[layer.part].channels
    planes = [_plane(channels[name], name, size) for name in layer.channels]
    # Planes of float16 and float32 are stacked to float32.
    picture = np.stack(planes if len(planes) == 3 else planes * 3, axis=-1)
    return _srgb_of_xyz(picture) if layer.is_xyz else picture


def corner(payload: bytes) -> tuple[int, int]:
    """Column and row of the first pixel, in the frame of which a picture may be a part.

    Raises:
        ValueError: the header is malformed, or has no colour channels.
    """
    headers = [part.header for part in _open(payload, header_only=True).parts]
    header = headers[find_layer(headers).part]
    data, frame = header["dataWindow"][0], header["displayWindow"][0]
    return int(data[0]) - int(frame[0]), int(data[1]) - int(frame[1])


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
    import OpenEXR  # needed by few

    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    # The library writes strided arrays wrongly, without an error.
    file = OpenEXR.File(header, {"RGB": np.ascontiguousarray(picture)})
    buffer = io.BytesIO()
    file.write(buffer)
    return buffer.getvalue()


def _open(payload: bytes, **options: bool) -> OpenEXR.File:
    """The file as the library opens it, with at least one part."""
    import OpenEXR  # needed by few

    try:
        file = OpenEXR.File(io.BytesIO(payload), **options)
    except (RuntimeError, ValueError, TypeError) as error:
        raise ValueError(f"OpenEXR: {error}") from error
    # The library reports unreadable pixels by a file without parts.
    if not file.parts:
        raise ValueError("it is truncated or damaged")
    return file


def _read_header(payload: bytes) -> tuple[Layer, tuple[int, int]]:
    """The channels of the colour, and the (height, width) of their data window."""
    headers = [part.header for part in _open(payload, header_only=True).parts]
    sizes = [_checked_size(header, len(payload)) for header in headers]
    layer = find_layer(headers)
    return layer, sizes[layer.part]


def _checked_size(header: dict[str, Any], byte_count: int) -> tuple[int, int]:
    """The (height, width) of the data window of a part, which so many bytes can hold."""
    first, last = header["dataWindow"]
    width, height = (int(b) - int(a) + 1 for a, b in zip(first, last, strict=True))
    if height < 1 or width < 1 or height * width > MAX_PIXELS:
        raise ValueError(f"its size is {width} x {height}; expected 1 to {MAX_PIXELS} pixels")
    if height * width > byte_count * MAX_PIXELS_PER_BYTE:
        raise ValueError(f"it is truncated: {byte_count} bytes cannot hold {width} x {height}")
    return height, width


def _srgb_of_xyz(picture: np.ndarray) -> np.ndarray:
    """Linear sRGB `[H, W, 3]` of XYZ, in the same type; colours beyond sRGB become negative."""
    rgb = picture.astype(np.float64) @ SRGB_OF_XYZ.T
    return rgb.astype(picture.dtype)


def _plane(channel: OpenEXR.Channel, name: str, size: tuple[int, int]) -> np.ndarray:
    """The pixels `[H, W]` of one channel."""
    pixels = channel.pixels
    if not isinstance(pixels, np.ndarray) or pixels.dtype not in FLOAT_TYPES:
        raise ValueError(f"its channel {name} holds no floats; expected HALF or FLOAT")
    if pixels.shape != size:
        raise ValueError(f"its channel {name} is {pixels.shape}; expected {size}")
    return pixels
