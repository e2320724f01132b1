"""Pictures of the page: amplified differences, colour maps, PNG data URIs."""

from __future__ import annotations

import base64
import colorsys
from collections.abc import Sequence

import numpy as np
from torch import Tensor

from ..render.display import SHOWN_FRACTION, Codes, encode_png

# Largest amplification of differences, a power of two.
MAX_GAIN = 64
# Fraction of a turn between the hues of successive clusters: they differ for any number.
GOLDEN_TURN = 0.618034
# (saturation, value) in turn, so that clusters of similar hue still differ.
TONES = ((0.45, 0.92), (0.70, 0.72), (0.30, 0.78), (0.62, 0.98))
# From few to many; every stop differs from a white and from a black page.
HEAT = ((52, 42, 110), (48, 98, 150), (42, 152, 136), (140, 196, 70), (250, 214, 60))


def difference_gain(worst: float) -> int:
    """The largest power of two, at most 64, that amplifies a difference `worst` to 1 at most."""
    gain = 1
    while 2 * gain * worst <= 1.0 and gain < MAX_GAIN:
        gain *= 2
    return gain


def shared_gain(differences: Sequence[Tensor]) -> int:
    """The gain for the 99th percentile of exposed differences, `[H, W, 3]` each."""
    sizes = (part.abs().cpu().numpy() for part in differences)
    return difference_gain(max(float(np.quantile(size, SHOWN_FRACTION)) for size in sizes))


def cluster_colours(number: int) -> Codes:
    """A colour for each cluster, `[K, 3]`; the same for cluster k in every report."""
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
    """A colour `[3]` as CSS writes it: `#3062ab`."""
    return "#" + bytes(codes.tolist()).hex()


def png_uri(codes: Codes) -> str:
    """A data URI of 8-bit codes `[H, W, 3]`, row 0 at the top."""
    return "data:image/png;base64," + base64.b64encode(encode_png(codes)).decode("ascii")
