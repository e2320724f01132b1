"""8-bit pictures, JPEG and PNG among them, by Pillow."""

from __future__ import annotations

import io

import numpy as np
from PIL import Image

from ..codes import Expansion, TableExpansion

TITLE = "JPEG, PNG"
SUFFIXES = (".jpg", ".jpeg", ".png", ".bmp", ".ppm")
HDR = False
# Grey pictures become RGB; other modes have no plain meaning as reflectance.
MODES = frozenset({"RGB", "L"})
# No format codes more pixels in a byte; a header that claims more would only cost memory.
PIXELS_PER_BYTE = 4096


def accepts(head: bytes) -> bool:
    """Always: Pillow knows so many formats that it says itself what it cannot read."""
    return True


def decode(payload: bytes) -> np.ndarray:
    """Codes `[H, W, 3]` uint8, encoded with a gamma.

    Raises:
        OSError: truncated, or not a picture.
        ValueError: neither RGB nor grey, or more than 8 bits.
    """
    with _opened(payload) as image:
        if image.mode not in MODES:
            raise ValueError(f"mode {image.mode} instead of 8-bit RGB or grey: convert it to RGB")
        image.load()  # here, so that a truncated file raises its own error
        return np.asarray(image if image.mode == "RGB" else image.convert("RGB"))


def expansion(gamma: float) -> Expansion:
    """By the gamma that the pictures were encoded with for a display."""
    return TableExpansion.gamma(gamma)


def _opened(payload: bytes) -> Image.Image:
    image = Image.open(io.BytesIO(payload))
    if image.width * image.height > PIXELS_PER_BYTE * len(payload):
        raise ValueError(
            f"{image.width} x {image.height} pixels cannot come from {len(payload)} bytes"
        )
    return image
