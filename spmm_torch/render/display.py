"""Linear pictures for screens and files: exposure, display curve, PNG, EXR and GIF."""

from __future__ import annotations

import io
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from PIL import Image
from torch import Tensor

from ..data.codecs import openexr
from ..runtime.atomic import new_file

# Fraction of values that measured pictures show without clipping; some of their pixels are faulty.
SHOWN_FRACTION = 0.99
# The same of rendered pictures, whose highlights must not burn out.
RENDERED_FRACTION = 0.999
# The display curve of sRGB [IEC 61966-2-1].
SRGB_KNEE, SRGB_SLOPE, SRGB_SCALE, SRGB_GAMMA = 0.0031308, 12.92, 1.055, 2.4
# Milliseconds of a frame of a turntable; a multiple of 10, as GIF counts hundredths.
FRAME_TIME = 80

# Display values from 0 to 255 of a picture `[H, W, 3]`, row 0 at the top.
Codes = NDArray[np.uint8]


def auto_exposure(pictures: Sequence[Tensor], coverages: Sequence[Tensor]) -> float:
    """The factor that maps the 99.9th percentile of covered pixels to 1; 1 if they are all black.

    Pictures that are compared share one factor.

    Args:
        pictures: linear, `[H, W, C]` each.
        coverages: covered fraction of each pixel, `[H, W]` each.
    """
    values = [
        picture[coverage > 0.0].flatten().cpu().numpy()
        for picture, coverage in zip(pictures, coverages, strict=True)
    ]
    return white_exposure(np.concatenate(values), RENDERED_FRACTION)


def white_exposure(values: np.ndarray, fraction: float = SHOWN_FRACTION) -> float:
    """The factor that maps the quantile `fraction` of values to 1; 1 if they are all black."""
    for white in (np.quantile(values, fraction), values.max()):
        if white > 0.0:
            return 1.0 / float(white)
    return 1.0


def encode_display(linear: Tensor, gamma: float | None = None) -> Tensor:
    """Display values in 0..1 of linear values `[...]`, which are clipped.

    Args:
        linear: of any shape.
        gamma: a plain exponent 1 / gamma; None for the sRGB curve.
    """
    shown = linear.clamp(0.0, 1.0)
    if gamma is not None:
        return shown ** (1.0 / gamma)
    curve = SRGB_SCALE * shown ** (1.0 / SRGB_GAMMA) - (SRGB_SCALE - 1.0)
    return torch.where(shown <= SRGB_KNEE, SRGB_SLOPE * shown, curve)


def display_codes(picture: Tensor, exposure: float = 1.0, gamma: float | None = None) -> Codes:
    """8-bit codes `[H, W, 3]` of a linear picture `[H, W, 3]` times `exposure`."""
    shown = encode_display(picture * exposure, gamma)
    return torch.round(shown * 255.0).to(torch.uint8).cpu().numpy()


def encode_png(codes: Codes) -> bytes:
    """The content of a PNG file."""
    buffer = io.BytesIO()
    Image.fromarray(np.ascontiguousarray(codes)).save(buffer, "PNG", optimize=True)
    return buffer.getvalue()


def write_png(path: Path | str, codes: Codes) -> None:
    """Writes 8-bit codes.

    Raises:
        OutputError: the file cannot be written.
    """
    with new_file(path) as temporary:
        temporary.write_bytes(encode_png(codes))


def write_exr(path: Path | str, picture: Tensor) -> None:
    """Writes a linear picture `[H, W, 3]`, single floats, nothing clipped.

    Raises:
        OutputError: the file cannot be written.
    """
    with new_file(path) as temporary:
        temporary.write_bytes(openexr.encode(picture.float().cpu().numpy()))


def write_gif(path: Path | str, frames: Sequence[Codes]) -> None:
    """Writes frames of 8-bit codes as an endless animation.

    Raises:
        OutputError: the file cannot be written.
    """
    images = [Image.fromarray(frame) for frame in frames]
    with new_file(path) as temporary:
        images[0].save(
            temporary,
            "GIF",
            save_all=True,
            append_images=images[1:],
            duration=FRAME_TIME,
            loop=0,
        )
