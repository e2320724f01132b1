"""PSNR of what a display shows: of 8-bit values, clipped and by the sRGB curve."""

from __future__ import annotations

import numpy as np
from torch import Tensor

from ..metrics import psnr_db
from ..render.display import Codes

# The largest code.
WHITE = 255
# Mean squared error of values that are rounded to whole codes: nearer ones look the same, and
# their PSNR is no larger than 58.9 dB.
ROUNDING_ERROR = 1.0 / 12.0


def display_psnr(original: Codes, model: Codes, counts: Tensor | None = None) -> float:
    """PSNR in decibels of 8-bit codes `[H, W, C]`, with a peak of 255.

    Args:
        original, model: of pictures under one exposure.
        counts: pixels that count, `[H, W]` bool; None: all.
    """
    difference = original.astype(np.float64) - model
    if counts is not None:
        difference = difference[counts.numpy()]
    mean = max(float(np.square(difference).mean()), ROUNDING_ERROR)
    return psnr_db(WHITE, mean, 1)
