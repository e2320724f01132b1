"""Netpbm pictures of more than 8 bits (.ppm, .pgm), which Pillow cuts to 8.

Source: the manuals `ppm` and `pgm` of Netpbm.
"""

from __future__ import annotations

import re

import numpy as np

# Magic number, width, height and largest code, between spaces and comments; one space ends them.
GAP = rb"(?:\s|#[^\n]*\n)+"
HEADER = re.compile(rb"P([2356])" + (GAP + rb"(\d{1,9})") * 3 + rb"\s")
COMMENT = re.compile(rb"#[^\n]*")
PLAIN = (b"2", b"3")  # codes are decimal numbers
COLOURED = (b"3", b"6")
BYTE_MAX, CODE_MAX = 255, 65535


def is_deep(payload: bytes) -> bool:
    """Whether a file is a Netpbm picture with codes above 255."""
    header = HEADER.match(payload)
    return header is not None and int(header[4]) > BYTE_MAX


def decode_deep(payload: bytes) -> np.ndarray:
    """Codes `[H, W, B]` uint16 of a picture for which `is_deep` holds, 65535 for its largest code.

    Raises:
        ValueError: the picture is truncated, or a code exceeds the largest one.
    """
    header = HEADER.match(payload)
    if header is None:
        raise ValueError("its header is malformed")
    width, height, largest = int(header[2]), int(header[3]), int(header[4])
    count = width * height * (3 if header[1] in COLOURED else 1)
    codes = _codes(payload[header.end() :], header[1] in PLAIN, count)
    if largest > CODE_MAX or len(codes) < count or not count:
        raise ValueError(f"it is truncated: {len(codes)} of {count} codes up to {largest}")
    low, high = codes.min(), codes.max()
    if low < 0 or high > largest:
        raise ValueError(f"it holds codes from {low} to {high}; expected 0 to {largest}")
    full = np.rint(codes * (CODE_MAX / largest)).astype(np.uint16)
    return full.reshape(height, width, -1)


def _codes(pixels: bytes, plain: bool, count: int) -> np.ndarray:
    """The first `count` codes `[N]` of the pixels, fewer if they end early."""
    if plain:
        words = COMMENT.sub(b"", pixels).split(maxsplit=count)[:count]
        return np.array([int(word) for word in words], dtype=np.int64)
    whole = min(len(pixels) // 2, count)
    return np.frombuffer(pixels, ">u2", whole)
