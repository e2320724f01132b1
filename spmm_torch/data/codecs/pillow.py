"""Pictures of 8 bits such as JPEG and PNG, decoded by Pillow, and PNG and PPM of 16 bits.

Pillow cuts 16 bits to 8 where there is more than grey, so imagecodecs reads such PNG. Pictures are
turned as their EXIF orientation says. Colour profiles are ignored, of which
`data/stated_colour.py` tells.
"""

from __future__ import annotations

import io

import numpy as np
from PIL import Image

from ..expansion import DepthExpansion, Expansion
from .arrangement import ORIENTATION_TAG, rgb_of, upright
from .base import UnsuitableError, refuse_foreign
from .netpbm import decode_deep, is_deep

TITLE = "JPEG, PNG"
SUFFIXES = (
    *(".jpg", ".jpeg", ".jpe", ".jfif", ".png", ".webp"),
    *(".bmp", ".ppm", ".pgm", ".pnm", ".tga"),
)
HDR = False
# Names that Pillow has for formats; TGA is last, as it has no magic number.
FORMATS = ("JPEG", "PNG", "BMP", "PPM", "WEBP", "TGA")
# Formats of which a file may hold several pictures, none of them the main one.
ANIMATED = ("PNG", "WEBP", "TIFF")
# Modes of Pillow that are grey or RGB of 8 bits; others are no reflectance, or have more bits.
MODES = frozenset({"1", "L", "LA", "P", "PA", "RGB", "RGBA", "RGBX"})
# Largest number of pixels that a byte can code in any format; a header may lie.
MAX_PIXELS_PER_BYTE = 4096
PNG_DEPTH = 24  # position of the bit depth in a PNG
# The first bytes of a PNG, what a chunk of it has beside its content, and chunks without pixels, of
# which Pillow refuses large ones: colour profiles and texts, as of programs that keep their scene.
PNG_START, PNG_CHUNK = b"\x89PNG\r\n\x1a\n", 12
PNG_NOTES = frozenset({b"iCCP", b"tEXt", b"zTXt", b"iTXt"})


def accepts(head: bytes) -> bool:
    """Whether a file is tried with Pillow: always, as Pillow knows many formats."""
    return True


def decode(payload: bytes, ignore_alpha: bool = False) -> np.ndarray:
    """Codes `[H, W, 3]` of uint8, or uint16 of deeper pictures, encoded with a gamma.

    Raises:
        OSError: the picture is truncated or of no known format.
        ValueError: the picture is neither RGB nor grey, transparent, or one of several in the file.
    """
    try:
        return decode_as(payload, FORMATS, ignore_alpha)
    except ValueError:
        if not payload.startswith(PNG_START) or (bare := _without_notes(payload)) == payload:
            raise
    return decode_as(bare, FORMATS, ignore_alpha)


def decode_as(payload: bytes, formats: tuple[str, ...], ignore_alpha: bool) -> np.ndarray:
    """Codes `[H, W, 3]` of a picture of some of Pillow's formats; see `decode`.

    Raises:
        OSError: the picture is truncated or of another format.
        ValueError: the picture is neither RGB nor grey, transparent, or one of several in the file.
    """
    with _opened(payload, formats) as image:
        if image.format == "PPM" and is_deep(payload):
            codes = rgb_of(decode_deep(payload))
        elif image.format == "PNG" and payload[PNG_DEPTH] > 8:
            codes = rgb_of(_decode_deep_png(image, payload), ignore_alpha)
        else:
            codes = _eight_bits(image, ignore_alpha)
        return upright(codes, image.getexif().get(ORIENTATION_TAG))


def expansion(gamma: float) -> Expansion:
    """The expansion of codes that were encoded with a display gamma."""
    return DepthExpansion(gamma)


def _without_notes(payload: bytes) -> bytes:
    """A PNG without texts and colour profiles."""
    kept, place = [PNG_START], len(PNG_START)
    while place < len(payload):
        length = int.from_bytes(payload[place : place + 4], "big") + PNG_CHUNK
        if payload[place + 4 : place + 8] not in PNG_NOTES:
            kept.append(payload[place : place + length])
        place += length
    return b"".join(kept)


def _opened(payload: bytes, formats: tuple[str, ...]) -> Image.Image:
    """The picture, whose pixels are not decoded yet."""
    try:
        image = Image.open(io.BytesIO(payload), formats=formats)
    except Image.DecompressionBombError as error:
        raise UnsuitableError(
            f"it has more pixels than Pillow opens, {2 * (Image.MAX_IMAGE_PIXELS or 0):,}; "
            f"expected the picture of a texture, of some millions: scale it down, or cut it"
        ) from error
    except Image.UnidentifiedImageError:
        refuse_foreign(payload)
        raise ValueError(f"cannot identify its format; expected {', '.join(formats)}") from None
    if image.width * image.height > MAX_PIXELS_PER_BYTE * len(payload):
        raise ValueError(
            f"{image.width} x {image.height} pixels cannot come from {len(payload)} bytes"
        )
    if image.format in ANIMATED and getattr(image, "n_frames", 1) > 1:
        raise UnsuitableError("it holds several pictures; expected one: save the right one alone")
    return image


def _eight_bits(image: Image.Image, ignore_alpha: bool) -> np.ndarray:
    """Codes `[H, W, 3]` uint8 of a picture."""
    if image.mode not in MODES:
        raise UnsuitableError(f"mode {image.mode} instead of RGB or grey: convert it to RGB")
    image.load()  # raises here if the file is truncated
    if image.mode == "RGB" and "transparency" not in image.info:
        return np.asarray(image)
    if image.has_transparency_data:
        return rgb_of(np.asarray(image.convert("RGBA")), ignore_alpha)
    return np.asarray(image.convert("RGB"))


def _decode_deep_png(image: Image.Image, payload: bytes) -> np.ndarray:
    """Codes `[H, W, B]` uint16 of a PNG of 16 bits."""
    if "transparency" in image.info:
        raise UnsuitableError("one of its colours is transparent; save it without transparency")
    import imagecodecs  # needed by few, and slow to load

    try:
        codes = imagecodecs.png_decode(payload)
    except imagecodecs.PngError as error:
        raise ValueError(f"it is truncated or damaged: {error}") from error
    return codes.reshape(image.height, image.width, -1)
