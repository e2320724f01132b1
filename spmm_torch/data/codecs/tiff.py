"""TIFF pictures (.tif): of up to 8 bits by Pillow, of 16 bits and floats by tifffile.

Codes of 8 and 16 bits are encoded with a gamma, floats are linear. Pictures are turned as their
orientation tag says.
"""

from __future__ import annotations

import io
import logging
from typing import TYPE_CHECKING

import numpy as np

from ..expansion import DepthExpansion, Expansion
from .arrangement import ORIENTATION_TAG, rgb_of, upright
from .base import UnsuitableError
from .pillow import MAX_PIXELS_PER_BYTE, decode_as

if TYPE_CHECKING:
    from tifffile import TiffFile, TiffPage

TITLE = "TIFF"
SUFFIXES = (".tif", ".tiff")
HDR = True  # of floats
MAGIC = (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+")
# Photometric interpretations: white is 0, black is 0, RGB.
WHITE_IS_ZERO, BLACK_IS_ZERO, RGB = 0, 1, 2
COLOUR_CHANNELS = {WHITE_IS_ZERO: 1, BLACK_IS_ZERO: 1, RGB: 3}
UNSPECIFIED = 0  # kind of a channel beside the colour that is no alpha
# Kinds of pages beside the picture itself: reduced copies, and masks.
COPY, MASK = 1, 4
CODE_MAX = 65535


def accepts(head: bytes) -> bool:
    """Whether a file that starts with these bytes is a TIFF picture."""
    return head.startswith(MAGIC)


def decode(payload: bytes, ignore_alpha: bool = False) -> np.ndarray:
    """Codes `[H, W, 3]` of uint8, uint16, float16 or float32; doubles are rounded.

    Raises:
        OSError: a picture of 8 bits is truncated or malformed.
        ValueError: the picture is truncated, malformed, transparent, neither grey nor RGB, of
            integers whose white is not known, or one of several in the file.
    """
    # Imported here, as it takes longer than all of Pillow and few sets of pictures are TIFF.
    from tifffile import TiffFile

    logging.getLogger("tifffile").setLevel(logging.CRITICAL)  # errors are raised, not printed
    try:
        with TiffFile(io.BytesIO(payload)) as file:
            page = _only_page(file)
            _check_bytes(page, len(payload))
            unknown_to_pillow = file.is_bigtiff and file.byteorder == ">"
            if page.bitspersample <= 8 and not unknown_to_pillow:
                return decode_as(payload, ("TIFF",), ignore_alpha)
            orientation = page.tags.valueof(ORIENTATION_TAG)
            return upright(rgb_of(_deep_codes(page), ignore_alpha), orientation)
    except (MemoryError, OSError, ValueError, Warning):
        raise
    except Exception as error:  # of damaged files both libraries raise whatever their steps meet
        raise ValueError(f"it is damaged: {error}") from error


def expansion(gamma: float) -> Expansion:
    """The expansion of codes: by a display gamma, except for floats."""
    return DepthExpansion(gamma)


def _only_page(file: TiffFile) -> TiffPage:
    """The page that holds the picture, beside which there are only copies and masks."""
    pages = [page.aspage() for page in file.pages]
    whole = [page for page in pages if not page.subfiletype & (COPY | MASK)]
    if len(whole) != 1:
        raise UnsuitableError(
            f"it holds {len(whole)} pictures; expected one: save the right one alone"
        )
    return whole[0]


def _check_bytes(page: TiffPage, byte_count: int) -> None:
    """Refuses pixels that are beyond the end of the file, and a size that it cannot hold."""
    ends = [a + b for a, b in zip(page.dataoffsets, page.databytecounts, strict=True)]
    if max(ends, default=byte_count + 1) > byte_count:
        raise ValueError(f"it is truncated: its pixels go on after {byte_count} bytes")
    pixels = page.imagewidth * page.imagelength * page.imagedepth
    if not 0 < pixels <= MAX_PIXELS_PER_BYTE * byte_count:
        raise ValueError(
            f"{page.imagewidth} x {page.imagelength} pixels cannot come from {byte_count} bytes"
        )


def _deep_codes(page: TiffPage) -> np.ndarray:
    """Codes `[H, W, B]` of a page by tifffile: colour, and alpha if there is one."""
    kind = int(page.photometric)
    if kind not in COLOUR_CHANNELS or page.imagedepth != 1:
        name = getattr(page.photometric, "name", kind)
        raise UnsuitableError(f"its colours are {name}; expected grey or RGB: convert it")
    dtype = page.dtype
    if dtype is None or dtype.kind not in "uf" or (dtype.kind == "u" and dtype.itemsize > 2):
        raise UnsuitableError(
            f"it holds {page.bitspersample}-bit {dtype} numbers, whose white is not known; "
            f"expected 8 or 16 bits, or floats: convert it"
        )
    if dtype.kind == "f" and kind == WHITE_IS_ZERO:
        raise UnsuitableError(
            "it holds floats of which 0 is white; expected 0 as black: convert it"
        )
    codes = _pixels(page)
    if dtype.kind == "u":
        codes = _full_scale(codes, page.bitspersample)
        codes = CODE_MAX - codes if kind == WHITE_IS_ZERO else codes
    return _without_others(codes, COLOUR_CHANNELS[kind], page.extrasamples)


def _pixels(page: TiffPage) -> np.ndarray:
    """Codes `[H, W, B]` in the byte order of this machine, doubles as floats."""
    codes = page.asarray()
    if codes.ndim == 3 and page.axes.startswith("S"):  # channel after channel
        codes = np.moveaxis(codes, 0, -1)
    codes = codes.reshape(page.imagelength, page.imagewidth, -1)
    single = np.float32 if codes.dtype.itemsize == 8 else codes.dtype.newbyteorder("=")
    return codes.astype(single, copy=False)


def _full_scale(codes: np.ndarray, depth: int) -> np.ndarray:
    """Codes of a depth of up to 16 bits as codes of 16 bits."""
    if depth == 16:
        return codes
    return np.rint(codes * (CODE_MAX / ((1 << depth) - 1))).astype(np.uint16)


def _without_others(codes: np.ndarray, colours: int, extra: tuple[int, ...]) -> np.ndarray:
    """Codes of the colour, and of alpha if there is one, of all channels."""
    if codes.shape[2] == colours + 1 and tuple(extra) == (UNSPECIFIED,):
        return codes[..., :colours]
    if codes.shape[2] > colours + 1:
        raise UnsuitableError(f"it has {codes.shape[2]} channels; expected grey or RGB: convert it")
    return codes
