"""Pictures of the page: linear values to display codes, colour maps, PNG data URIs."""

from __future__ import annotations

import base64
import colorsys
import io

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from ..data.btf import DISPLAY_GAMMA

# This part of a picture's values is shown without clipping.
SHOWN_FRACTION = 0.99
# The amplification of differences doubles up to this.
MAX_GAIN = 64
# Successive hues are this part of a turn apart: neighbours differ, whatever the count.
GOLDEN_TURN = 0.618034
# (saturation, value) in turn, so that hues that come close still differ.
TONES = ((0.45, 0.92), (0.70, 0.72), (0.30, 0.78), (0.62, 0.98))
# From few to many; all stops can be told from a white and from a black page.
HEAT = ((52, 42, 110), (48, 98, 150), (42, 152, 136), (140, 196, 70), (250, 214, 60))

Codes = NDArray[np.uint8]
Linear = NDArray[np.float32]


def exposure(original: Linear) -> float:
    """The factor that maps the 99th percentile of a picture to 1; 1 for a black one."""
    for white in (np.quantile(original, SHOWN_FRACTION), original.max()):
        if white > 0.0:
            return 1.0 / float(white)
    return 1.0


def difference_gain(worst: float) -> int:
    """The largest power of two, at most 64, that keeps differences of `worst` (exposed) below 1."""
    gain = 1
    while 2 * gain * worst <= 1.0 and gain < MAX_GAIN:
        gain *= 2
    return gain


def display(linear: Linear, factor: float) -> Codes:
    """8-bit codes `[H, W, 3]` of a linear picture times `factor`, gamma 2.2."""
    shown = np.clip(linear * factor, 0.0, 1.0) ** (1.0 / DISPLAY_GAMMA)
    return np.round(shown * 255.0).astype(np.uint8)


def cluster_colours(number: int) -> Codes:
    """A colour `[K, 3]` for each cluster; cluster k has the same one in every report."""
    colours = [
        colorsys.hsv_to_rgb(index * GOLDEN_TURN % 1.0, *TONES[index % len(TONES)])
        for index in range(number)
    ]
    return np.round(np.array(colours).reshape(-1, 3) * 255.0).astype(np.uint8)


def heat_colours(steps: int) -> Codes:
    """Colours `[steps, 3]` from few to many."""
    position = np.linspace(0.0, 1.0, steps) if steps > 1 else np.zeros(steps)
    stops = np.linspace(0.0, 1.0, len(HEAT))
    columns = [np.interp(position, stops, column) for column in zip(*HEAT, strict=True)]
    return np.round(np.stack(columns, axis=-1)).astype(np.uint8)


def css_colour(codes: Codes) -> str:
    """`#3062ab` of one colour `[3]`."""
    return "#" + bytes(codes.tolist()).hex()


def png_uri(codes: Codes) -> str:
    """A data URI of 8-bit codes `[H, W, 3]`, row 0 at the top."""
    buffer = io.BytesIO()
    Image.fromarray(np.ascontiguousarray(codes)).save(buffer, "PNG", optimize=True)
    return "data:image/png;base64," + base64.b64encode(buffer.getvalue()).decode("ascii")
