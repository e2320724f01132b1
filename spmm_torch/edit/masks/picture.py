"""Texels by a grey picture, such as one that was painted."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from PIL import Image, UnidentifiedImageError

from ...config.schema import REQUIRED, setting
from ...errors import DataError
from ...model.spmm import SPMM
from ..selection import Selection, select_texels

CODE_MAX = 255.0


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
        DataError: the file cannot be read as a picture.
        ConfigError: it has another size.
    """
    try:
        with Image.open(path) as image:
            codes = np.asarray(image.convert("L"))  # [H, W]
    except (OSError, UnidentifiedImageError, ValueError) as error:
        raise DataError(
            f"mask {path} cannot be read ({error}); expected a picture such as a PNG; check it."
        ) from error
    return select_texels(model, torch.from_numpy(codes / CODE_MAX).to(model.weight))
