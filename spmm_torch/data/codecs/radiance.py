"""Radiance pictures (.hdr): three mantissas and one shared exponent, a byte each.

A code (r, g, b, e) stands for (r, g, b) * 2^(e - 136), and for black where e = 0. Radiance itself
adds 1/2 to each mantissa. This module does not, so that zero stays zero, as in OpenCV, FreeImage
and stb. Values are divided by the `EXPOSURE` and `COLORCORR` lines, as the format demands: exactly
for powers of two, else rounded to the nearest code. `PRIMARIES` must be those of Rec.709, or those
that Radiance assumes without the line, which programs read alike.

Source: `filefmts.pdf` of Radiance; `scanlines.py` has the run-length encodings.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import torch
from torch import Tensor

from ..expansion import Expansion, TableExpansion
from .base import UnsuitableError
from .chromaticities import ROUNDING, are_rec709
from .scanlines import decode_scanlines, encode_scanlines

TITLE = "Radiance"
SUFFIXES = (".hdr", ".pic", ".rgbe")
HDR = True
MAGIC = b"#?"
ENCODING = "32-bit_rle_rgbe"
# Limits of a header, which is a few lines long: no file is searched to its end for more.
MAX_HEADER_LINES = 1000
MAX_LINE_BYTES = 1 << 16
MAX_PIXELS = 1 << 28
NO_SCALE = (1.0, 1.0, 1.0)
# Primaries that Radiance assumes, and what Photoshop writes for unknown ones.
RADIANCE_PRIMARIES = (0.64, 0.33, 0.29, 0.60, 0.15, 0.06, 1 / 3, 1 / 3)
UNKNOWN_PRIMARIES = (0.0,) * 8
MAX_SCALE = 1e30  # scaled values still fit into float32
RESOLUTION = re.compile(r"([-+])([XY]) +(\d{1,9}) +([-+])([XY]) +(\d{1,9})")

# Mantissas are fractions of 256 = 2^8, and exponents have a bias of 128.
EXPONENT_BIAS = 136
MAX_CODE = 255
SCALES = np.ldexp(np.float32(1.0), np.arange(256) - EXPONENT_BIAS)  # [256], by exponent
SCALES[0] = 0.0


@dataclass(frozen=True)
class Header:
    """The text before the pixels.

    Attributes:
        height, width: size of the picture.
        flip_rows, flip_columns: whether rows run upwards, and columns to the left.
        scale: divisor of the values of each channel.
        offset: position of the pixels in the file, in bytes.
    """

    height: int
    width: int
    flip_rows: bool
    flip_columns: bool
    scale: tuple[float, ...]
    offset: int


class RgbeExpansion:
    """The expansion by a shared exponent: `mantissa * 2 ** (exponent - 136)`, 0 for exponent 0."""

    elementwise: ClassVar[bool] = False
    # A table, as powers are not exact on every device.
    scale = TableExpansion(torch.from_numpy(SCALES))

    def __call__(self, codes: Tensor) -> Tensor:
        """Values `[..., 3]` float32 of codes `[..., 4]` uint8."""
        return codes[..., :3].float() * self.scale(codes[..., 3:])

    def bounds(self, codes: Tensor) -> tuple[float, float]:
        """The lowest and the highest value of codes `[..., 4]`; see `Expansion.bounds`."""
        low, high = self(codes).aminmax()
        return float(low), float(high)


def accepts(head: bytes) -> bool:
    """Whether a file that starts with these bytes is a Radiance picture."""
    return head.startswith(MAGIC)


def decode(payload: bytes, ignore_alpha: bool = False) -> np.ndarray:
    """The codes `[H, W, 4]` uint8 of a picture, row 0 at the top.

    Raises:
        ValueError: the picture is malformed, truncated, or not in RGBE.
    """
    header = _read_header(payload)
    codes = decode_scanlines(payload[header.offset :], header.height, header.width)
    if header.flip_rows:
        codes = codes[::-1]
    if header.flip_columns:
        codes = codes[:, ::-1]
    if header.scale != NO_SCALE:
        codes = float_to_rgbe(rgbe_to_float(codes) / np.array(header.scale))
    return np.ascontiguousarray(codes)


def expansion(gamma: float) -> Expansion:
    """The expansion of codes by their shared exponent, to linear values."""
    return RgbeExpansion()


def encode(picture: np.ndarray) -> bytes:
    """A Radiance file of codes `[H, W, 4]` uint8, run-length encoded where the width allows it.

    Raises:
        ValueError: the shape or type is another one, or a code would read as a run.
    """
    if picture.ndim != 3 or picture.shape[2] != 4 or 0 in picture.shape:
        raise ValueError(f"codes have shape {list(picture.shape)}; expected [H, W, 4]")
    if picture.dtype != np.uint8:
        raise ValueError(f"codes have type {picture.dtype}; expected uint8")
    height, width, _ = picture.shape
    header = f"#?RADIANCE\nFORMAT={ENCODING}\n\n-Y {height} +X {width}\n".encode("ascii")
    return header + encode_scanlines(picture)


def rgbe_to_float(codes: np.ndarray) -> np.ndarray:
    """Linear values `[..., 3]` float32 of codes `[..., 4]` uint8, exact."""
    return codes[..., :3] * SCALES[codes[..., 3:]]


def float_to_rgbe(values: np.ndarray) -> np.ndarray:
    """The nearest codes `[..., 4]` uint8 of linear values `[..., 3]`.

    Raises:
        ValueError: a value is negative, not finite, or beyond the largest exponent.
    """
    exact = np.asarray(values, dtype=np.float64)
    brightest = exact.max(axis=-1, keepdims=True)  # [..., 1]
    if not (exact >= 0.0).all() or not np.isfinite(brightest).all():
        raise ValueError("values are negative or not finite; Radiance pictures cannot hold them")
    _, power = np.frexp(brightest)
    # The exponent grows where a mantissa would round up to 256.
    power += np.rint(np.ldexp(brightest, 8 - power)) > MAX_CODE
    exponent = np.maximum(power + 128, 1)
    if exponent.max(initial=0) > MAX_CODE:
        raise ValueError(f"the value {brightest.max():g} is too large for a Radiance picture")
    mantissas = np.rint(np.ldexp(exact, EXPONENT_BIAS - exponent))
    exponent = np.where(mantissas.any(axis=-1, keepdims=True), exponent, 0)
    return np.concatenate((mantissas, exponent), axis=-1).astype(np.uint8)


def _read_header(payload: bytes) -> Header:
    """The header of a file; a ValueError if it is malformed."""
    if not accepts(payload):
        raise ValueError("it does not start like a Radiance picture")
    scale = NO_SCALE
    offset = 0
    for _ in range(MAX_HEADER_LINES):
        line, offset = _read_line(payload, offset)
        key, _, value = (part.strip() for part in line.partition("="))
        if key == "FORMAT" and value != ENCODING:
            raise UnsuitableError(
                f"its pixels are {value!r}; expected {ENCODING}: convert it to RGB"
            )
        if key == "PRIMARIES":
            _check_primaries(value)
        if key in ("EXPOSURE", "COLORCORR"):
            factors = _read_factors(key, value)
            scale = tuple(a * b for a, b in zip(scale, factors, strict=True))
        if not line:
            break
    else:
        raise ValueError("its header has no end")
    if not all(1.0 / MAX_SCALE <= factor <= MAX_SCALE for factor in scale):
        raise ValueError(f"its exposure is {scale}; expected positive numbers up to {MAX_SCALE:g}")
    line, offset = _read_line(payload, offset)
    return Header(*_read_resolution(line), scale, offset)


def _read_line(payload: bytes, offset: int) -> tuple[str, int]:
    """The stripped line at an offset, and the offset of the next line."""
    end = payload.find(b"\n", offset, offset + MAX_LINE_BYTES)
    if end < 0:
        raise ValueError("its header ends early")
    return payload[offset:end].decode("latin-1").strip(), end + 1


def _read_factors(key: str, value: str) -> list[float]:
    """The factors of the three channels in a header line."""
    factors = [float(word) for word in value.split()]
    if key == "EXPOSURE":
        factors = factors * 3
    if len(factors) != 3:
        raise ValueError(f"its header line is '{key}={value}'")
    return factors


def _check_primaries(value: str) -> None:
    """Refuses primaries whose colours are others than those that are read."""
    place = [float(word) for word in value.split()]
    known = any(
        len(place) == len(one) and np.allclose(place, one, rtol=0.0, atol=ROUNDING)
        for one in (RADIANCE_PRIMARIES, UNKNOWN_PRIMARIES)
    )
    if not known and (len(place) != len(RADIANCE_PRIMARIES) or not are_rec709(place)):
        raise UnsuitableError(
            f"its header line is 'PRIMARIES={value}'; expected those of Rec.709: convert it, for "
            f"instance by ra_xyze -r -p 0.64 0.33 0.30 0.60 0.15 0.06 0.3127 0.3290"
        )


def _read_resolution(line: str) -> tuple[int, int, bool, bool]:
    """The (height, width, flip_rows, flip_columns) of a line such as `-Y height +X width`.

    The files of ATRIUM have `+X width -Y height`, although their scanlines are rows from the bottom
    up.
    """
    found = RESOLUTION.fullmatch(line)
    if found is None:
        raise ValueError(f"its resolution line is {line[:80]!r}; expected '-Y height +X width'")
    first_sign, first_axis, first, second_sign, second_axis, second = found.groups()
    order = first_sign + first_axis + second_sign + second_axis
    if order == "+X-Y":
        height, width, flip_rows, flip_columns = int(second), int(first), True, False
    elif first_axis == "Y" and second_axis == "X":
        height, width = int(first), int(second)
        flip_rows, flip_columns = first_sign == "+", second_sign == "-"
    else:
        raise ValueError(f"its scanlines run as {line!r}; expected '-Y height +X width'")
    if not 0 < height * width <= MAX_PIXELS:
        raise ValueError(f"its size is {width} x {height}; expected 1 to {MAX_PIXELS} pixels")
    return height, width, flip_rows, flip_columns
