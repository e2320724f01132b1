"""8-bit pictures such as JPEG and PNG, decoded by Pillow."""

from __future__ import annotations

import io

import numpy as np
from PIL import Image

from ..codes import Expansion, TableExpansion

TITLE = "JPEG, PNG"
SUFFIXES = (".jpg", ".jpeg", ".png", ".bmp", ".ppm")
HDR = False
# Modes of Pillow: RGB, and grey, which becomes RGB; others are no reflectance.
MODES = frozenset({"RGB", "L"})
# Largest number of pixels that a byte can code in any format; a header may lie.
MAX_PIXELS_PER_BYTE = 4096


def accepts(head: bytes) -> bool:
    """Whether a file is tried with Pillow: always, as Pillow knows many formats."""
    return True


def decode(payload: bytes) -> np.ndarray:
    """Codes `[H, W, 3]` uint8, encoded with a gamma.

    Raises:
        OSError: the picture is truncated or of no known format.
        ValueError: the picture is neither RGB nor grey, or has more than 8 bits.
    """
    with _opened(payload) as image:
        if image.mode not in MODES:
            raise ValueError(f"mode {image.mode} instead of 8-bit RGB or grey: convert it to RGB")
        image.load()  # raises here if the file is truncated
        return np.asarray(image if image.mode == "RGB" else image.convert("RGB"))


def expansion(gamma: float) -> Expansion:
    """The expansion of codes that were encoded with a display gamma."""
    return TableExpansion.gamma(gamma)


def _opened(payload: bytes) -> Image.Image:
    """The picture, whose pixels are not decoded yet."""
    image = Image.open(io.BytesIO(payload))
    if image.width * image.height > MAX_PIXELS_PER_BYTE * len(payload):
        raise ValueError(
            f"{image.width} x {image.height} pixels cannot come from {len(payload)} bytes"
        )
    return image
