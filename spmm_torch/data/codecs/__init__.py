"""Codecs: one module for each format of a single picture, with the names of `base.Codec`.

A new format is one module and one line in `NAMES`.
"""

from __future__ import annotations

import struct
from importlib import import_module
from pathlib import Path
from typing import cast

import numpy as np
import torch
from PIL import Image
from torch import Tensor

from ..expansion import Expansion
from .base import Codec, UnsuitableError

__all__ = [
    "CODECS",
    "DECODE_ERRORS",
    "SUFFIXES",
    "Codec",
    "UnsuitableError",
    "codec_of",
    "is_linear",
    "read_picture",
]

# The first codec in this order that accepts a picture decodes it; Pillow accepts all, so is last.
NAMES = (
    "openexr",
    "radiance",
    "tiff",
    "pillow",
)
CODECS: tuple[Codec, ...] = tuple(
    cast("Codec", import_module(f".{name}", __name__)) for name in NAMES
)
SUFFIXES: tuple[str, ...] = tuple(suffix for codec in CODECS for suffix in codec.SUFFIXES)
DECODE_ERRORS = (
    OSError,
    EOFError,
    SyntaxError,
    ValueError,
    OverflowError,
    Image.DecompressionBombError,
    struct.error,  # of Pillow, at the end of truncated tags
    Warning,  # of Pillow about damaged tags, where a program turns warnings into errors
)
# Bytes by which a codec is found.
HEAD_BYTES = 64


def codec_of(payload: bytes) -> Codec:
    """The codec of a picture, found by its first bytes."""
    head = payload[:HEAD_BYTES]
    return next(codec for codec in CODECS if codec.accepts(head))


def read_picture(
    path: Path | str, *, ignore_alpha: bool = False, encoded: bool = False
) -> np.ndarray:
    """Values `[H, W, 3]` float32 of a picture file of any format and depth, without a gamma.

    Codes of 8 and 16 bits become 0 to 1; floats and Radiance pictures are as they are.

    Args:
        path: picture file.
        ignore_alpha: read what is transparent as if it were not.
        encoded: refuse linear values, where codes have another meaning.

    Raises:
        DECODE_ERRORS: the file cannot be read, or its picture not be decoded.
    """
    payload = Path(path).read_bytes()
    codec = codec_of(payload)
    codes = torch.from_numpy(np.array(codec.decode(payload, ignore_alpha)))  # Pillow's: read-only
    expand = codec.expansion(1.0)
    if encoded and is_linear(codes, expand):
        raise ValueError("it holds linear values; expected codes of 8 or 16 bits: convert it")
    return expand(codes).numpy()


def is_linear(codes: Tensor, expand: Expansion) -> bool:
    """Whether codes `[..., B]` of a picture stand for linear values, not for those of a display."""
    return codes.is_floating_point() or not expand.elementwise
