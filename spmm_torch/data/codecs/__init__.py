"""Codecs: one module for each way to store a single picture, as `base.Codec` says.

A new kind of picture is one module and one line in `NAMES`.
"""

from __future__ import annotations

from importlib import import_module
from typing import cast

from PIL import Image

from .base import Codec

__all__ = ["CODECS", "DECODE_ERRORS", "SUFFIXES", "Codec", "codec_of"]

# In the order in which they are asked. Pillow takes whatever the others leave, so it stays last.
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
HEAD_BYTES = 64


def codec_of(payload: bytes) -> Codec:
    """The codec of a picture, by its first bytes."""
    head = payload[:HEAD_BYTES]
    return next(codec for codec in CODECS if codec.accepts(head))
