"""Texels by a grey picture, such as one that was painted."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch

from ...config.schema import REQUIRED, setting
from ...data.codecs import DECODE_ERRORS, read_picture
from ...errors import DataError
from ...model.spmm import SPMM
from ..selection import Selection, select_texels

# Share by which white may exceed 1: a colour computed from others is rounded.
ROUNDING = 1e-4
# Weights of red, green and blue in a grey value [ITU-R BT.601].
LUMA = np.array([0.299, 0.587, 0.114])


@dataclass(frozen=True)
class PictureMask:
    """A grey picture of the size of the texture."""

    path: str = setting(REQUIRED, "a picture, white where the edit acts; relative to the script")

    def select(self, model: SPMM) -> Selection:
        """Its texels in a model."""
        return picture_selection(model, self.path)


def picture_selection(model: SPMM, path: Path | str) -> Selection:
    """Texels by a grey picture of the size of the texture: white is 1, black 0, grey between.

    Raises:
        DataError: the file cannot be read as a picture, or holds values beyond 0 to 1.
        ConfigError: it has another size.
    """
    try:
        values = read_picture(path)  # [H, W, 3]
    except DECODE_ERRORS as error:
        raise DataError(
            f"mask {path} cannot be read ({error}); expected a picture such as a PNG; check it."
        ) from error
    grey = np.ptp(values, axis=-1) == 0.0
    mask = np.where(grey, values[..., 0], values @ LUMA)  # grey keeps its bits
    if not (mask.min() >= 0.0 and mask.max() <= 1.0 + ROUNDING):  # also refuses NaN
        raise DataError(
            f"mask {path} has values from {mask.min():g} to {mask.max():g}; expected 0 to 1; "
            f"rescale it."
        )
    return select_texels(model, torch.from_numpy(mask).to(model.weight).clamp(max=1.0))
