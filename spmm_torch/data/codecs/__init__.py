"""Codecs: one module for each format of a single picture, with the names of `base.Codec`.

A new format is one module and one line in `NAMES`.
"""

from __future__ import annotations

from importlib import import_module
from typing import cast

from PIL import Image

from .base import Codec

__all__ = ["CODECS", "DECODE_ERRORS", "SUFFIXES", "Codec", "codec_of"]

# The first codec in this order that accepts a picture decodes it; Pillow accepts all, so is last.
NAMES = (
    "openexr",
    "radiance",
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
)
# Bytes by which a codec is found.
HEAD_BYTES = 64


def codec_of(payload: bytes) -> Codec:
    """The codec of a picture, found by its first bytes."""
    head = payload[:HEAD_BYTES]
    return next(codec for codec in CODECS if codec.accepts(head))
