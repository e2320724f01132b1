"""A rectangle of texels, counted from the top left corner of the texture."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from ...config.schema import REQUIRED, setting
from ...errors import ConfigError
from ...model.spmm import SPMM
from ..selection import Selection, select_texels


@dataclass(frozen=True)
class Rectangle:
    """A rectangle of texels."""

    x: int = setting(REQUIRED, "the leftmost column", low=0)
    y: int = setting(REQUIRED, "the topmost row", low=0)
    width: int = setting(REQUIRED, "number of columns", low=1)
    height: int = setting(REQUIRED, "number of rows", low=1)

    def check(self, model: SPMM) -> None:
        """Checks that it lies in the texture of a model.

        Raises:
            ConfigError: it is empty, or reaches out.
        """
        if self.width < 1 or self.height < 1:
            raise ConfigError(
                f"the rectangle is {self.width} x {self.height} texels; expected at least 1 x 1."
            )
        right, bottom = self.x + self.width, self.y + self.height
        if self.x < 0 or self.y < 0 or right > model.width or bottom > model.height:
            raise ConfigError(
                f"the rectangle from texel ({self.x}, {self.y}) to ({right - 1}, {bottom - 1}) "
                f"reaches out of the texture; expected columns 0 to {model.width - 1} and rows 0 "
                f"to {model.height - 1}."
            )

    def mask(self, model: SPMM) -> Tensor:
        """1 inside, 0 outside, `[H, W]`.

        Raises:
            ConfigError: it is empty, or reaches out of the texture.
        """
        self.check(model)
        mask = model.weight.new_zeros(model.height, model.width)
        mask[self.y : self.y + self.height, self.x : self.x + self.width] = 1.0
        return mask

    def select(self, model: SPMM) -> Selection:
        """Its texels in a model."""
        return select_texels(model, self.mask(model))


def bounds(mask: Tensor) -> Rectangle:
    """The smallest rectangle around the true texels of `mask [H, W]`; one at least must be true."""
    rows, columns = (torch.nonzero(mask.any(axis)).squeeze(-1) for axis in (1, 0))
    top, bottom = int(rows[0]), int(rows[-1])
    left, right = int(columns[0]), int(columns[-1])
    return Rectangle(left, top, right - left + 1, bottom - top + 1)
