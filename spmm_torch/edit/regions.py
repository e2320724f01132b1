"""Regions of a texture, in texels from the top left corner."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from ..errors import ConfigError
from ..model.spmm import SPMM


@dataclass(frozen=True)
class Rectangle:
    """Texels from column x and row y on; row 0 is the top."""

    x: int
    y: int
    width: int
    height: int

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


def bounds(mask: Tensor) -> Rectangle:
    """The smallest rectangle around the true texels of `mask [H, W]`, of which there is one."""
    rows, columns = (torch.nonzero(mask.any(axis)).squeeze(-1) for axis in (1, 0))
    top, bottom = int(rows[0]), int(rows[-1])
    left, right = int(columns[0]), int(columns[-1])
    return Rectangle(left, top, right - left + 1, bottom - top + 1)


@dataclass(frozen=True)
class Stripes:
    """Even stripes over the whole texture.

    Attributes:
        count: stripes across it.
        share: part of the period that a stripe covers, 0 to 1.
        soft: part of the period over which an edge fades, 0 for hard ones.
        shift: of the first stripe's middle, in periods.
        vertical: whether stripes run up and down, so that they alternate along a row.
    """

    count: int = 4
    share: float = 0.5
    soft: float = 0.0
    shift: float = 0.5
    vertical: bool = True

    def mask(self, model: SPMM) -> Tensor:
        """Shares `[H, W]` in [0, 1].

        Raises:
            ConfigError: a value out of its range.
        """
        if self.count < 1 or not 0.0 <= self.share <= 1.0 or not 0.0 <= self.soft <= 1.0:
            raise ConfigError(
                f"stripes have count {self.count}, share {self.share:g} and soft {self.soft:g}; "
                f"expected a count of at least 1, and 0 to 1."
            )
        length = model.width if self.vertical else model.height
        place = (torch.arange(length, device=model.weight.device) + 0.5) / length * self.count
        distance = torch.remainder(place - self.shift + 0.5, 1.0) - 0.5  # from the nearest middle
        inside = 0.5 * self.share - distance.abs()  # above 0 within the stripe
        if self.soft > 0.0:
            line = (inside / self.soft + 0.5).clamp(0.0, 1.0)
        else:
            line = (inside > 0.0).to(place)
        line = line.to(model.weight)
        shape = (model.height, model.width)
        return line.expand(shape) if self.vertical else line[:, None].expand(shape)
