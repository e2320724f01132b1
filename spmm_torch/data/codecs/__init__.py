"""Codecs: one module for each way to store a single picture.

A codec has `accepts(head) -> bool`, which judges by the first bytes; `read_size(payload)` gives
(height, width) from the header alone; `decode(payload)` gives codes `[H, W, B]`, row 0 at the top.
Malformed payloads raise one of `DECODE_ERRORS`. A new kind of picture = one module and one entry in
`CODECS`.
"""

from __future__ import annotations

from types import ModuleType

from PIL import Image

from . import openexr, pillow, radiance

__all__ = ["CODECS", "DECODE_ERRORS", "SUFFIXES", "codec_of"]

# Pillow takes whatever the others leave, so it comes last.
CODECS: tuple[ModuleType, ...] = (openexr, radiance, pillow)
SUFFIXES = (".jpg", ".jpeg", ".png", ".bmp", ".ppm", ".hdr", ".pic", ".rgbe", ".exr")
DECODE_ERRORS = (
    OSError,
    EOFError,
    SyntaxError,
    ValueError,
    OverflowError,
    Image.DecompressionBombError,
)
HEAD_BYTES = 64


def codec_of(payload: bytes) -> ModuleType:
    """The codec of a picture, by its first bytes."""
    head = payload[:HEAD_BYTES]
    return next(codec for codec in CODECS if codec.accepts(head))
