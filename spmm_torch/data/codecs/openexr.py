"""OpenEXR pictures (.exr): half or single floats, kept bit for bit.

`exr_layers.py` finds the channels of the colour. X, Y and Z become linear sRGB, and so do R, G and
B whose header names other chromaticities, as those of ACES and Rec.2020; Y alone is grey. Other
channels are ignored, and so is what the display window has beyond the pixels. The OpenEXR library
reads and writes in memory.
"""

from __future__ import annotations

import io
from typing import TYPE_CHECKING, Any

import numpy as np

from ..expansion import Expansion, FloatExpansion
from .base import UnsuitableError
from .chromaticities import REC709, are_rec709, rec709_of_rgb, xyz_of_rgb
from .exr_layers import RGB, Layer, find_layer

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
CHROMATICITIES = "chromaticities"  # in the header; without them they are those of Rec.709


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
    part = _open(payload, separate_channels=True).parts[layer.part]
    planes = [_plane(part.channels[name], name, size) for name in layer.channels]
    # Planes of float16 and float32 are stacked to float32.
    picture = np.stack(planes if len(planes) == 3 else planes * 3, axis=-1)
    matrix = _to_rec709(layer, part.header)
    return picture if matrix is None else _mixed(picture, matrix)


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


def _to_rec709(layer: Layer, header: dict[str, Any]) -> np.ndarray | None:
    """The matrix `[3, 3]` to linear RGB of Rec.709, which is that of sRGB; None if it is that."""
    if layer.is_xyz:
        return np.linalg.inv(xyz_of_rgb(REC709))
    named = header.get(CHROMATICITIES)
    if named is None or len(layer.channels) < len(RGB) or are_rec709(named):
        return None
    return rec709_of_rgb(named)


def _mixed(picture: np.ndarray, matrix: np.ndarray) -> np.ndarray:
    """Channels `[H, W, 3]` by a matrix, in the same type unless its range is too small.

    Colours beyond those of Rec.709 become negative.
    """
    rgb = picture.astype(np.float64) @ matrix.T
    fits = np.abs(rgb[np.isfinite(rgb)]).max(initial=0.0) <= np.finfo(picture.dtype).max
    return rgb.astype(picture.dtype if fits else np.float32)


def _plane(channel: OpenEXR.Channel, name: str, size: tuple[int, int]) -> np.ndarray:
    """The pixels `[H, W]` of one channel."""
    pixels = channel.pixels
    if not isinstance(pixels, np.ndarray) or pixels.dtype not in FLOAT_TYPES:
        raise UnsuitableError(
            f"its channel {name} holds whole numbers (UINT), whose white is not known; expected "
            f"HALF or FLOAT: convert it"
        )
    if pixels.shape != size:
        raise ValueError(f"its channel {name} is {pixels.shape}; expected {size}")
    return pixels
