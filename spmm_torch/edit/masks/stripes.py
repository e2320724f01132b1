"""Even stripes over the whole texture."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from ...config.schema import setting
from ...errors import ConfigError
from ...model.spmm import SPMM
from ..selection import Selection, select_texels


@dataclass(frozen=True)
class Stripes:
    """Even stripes over the whole texture."""

    count: int = setting(4, "number of stripes", low=1)
    share: float = setting(0.5, "part of the period that a stripe covers", low=0.0, high=1.0)
    soft: float = setting(0.0, "part of the period over which an edge fades", low=0.0, high=1.0)
    shift: float = setting(0.5, "middle of the first stripe, in periods", low=0.0, high=1.0)
    vertical: bool = setting(True, "whether stripes run up and down")

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

    def select(self, model: SPMM) -> Selection:
        """Their texels in a model."""
        return select_texels(model, self.mask(model))
