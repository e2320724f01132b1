"""What the checks need of all values of a BTF, by one pass over its views."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import torch
from torch import Tensor

from ..data import BTF
from ..runtime.memory import slices

# Values of a block: 64 MB of float32.
BLOCK_VALUES = 1 << 24
# Texels whose values are kept, and the side of the middle of the mean picture of each view.
KEPT_TEXELS, KEPT_SIDE = 64, 128
# A pixel is hot if it is so many times brighter than the `HOT_RANK`-th brightest of its picture.
HOT_RATIO, HOT_RANK = 200.0, 4


@dataclass
class Sums:
    """Figures of the values of a BTF; pairs without a picture have none.

    Attributes:
        mean: over texels, `[V, L, C]` float64.
        kept: values of some texels, `[S, V, L]`, mean of channels.
        pictures: the middle of each view's picture, mean of lights and channels, `[V, h, w]`.
        highest, lowest: of all values.
        at_highest: number of values that are the highest.
        zeros: number of values that are 0 or below.
        count: number of all values.
        hot: (view, light, texel) of hot pixels.
    """

    mean: Tensor
    kept: Tensor
    pictures: Tensor
    highest: float = -math.inf
    lowest: float = math.inf
    at_highest: int = 0
    zeros: int = 0
    count: int = 0
    hot: list[tuple[int, int, int]] = field(default_factory=list)

    @classmethod
    def of(cls, btf: BTF, progress: Callable[[int], object] = lambda count: None) -> Sums:
        """The figures of a BTF; memory is bounded whatever its size.

        Args:
            btf: decoded at once or by and by.
            progress: called with the number of views just done.
        """
        views, lights = len(btf.view), len(btf.light)
        kept = torch.linspace(0, btf.texel_count - 1, min(KEPT_TEXELS, btf.texel_count)).long()
        middle = _middle(btf.height, btf.width)
        sums = cls(
            torch.zeros(views, lights, btf.channels, dtype=torch.float64),
            torch.zeros(len(kept), views, lights),
            torch.zeros(views, *middle.shape),
        )
        size = max(BLOCK_VALUES // (btf.texel_count * btf.channels), 1)
        for view in range(views):
            for block in slices(lights, size):
                start = view * lights
                values = btf.store().pairs(start + block.start, start + block.stop)  # [T, n, C]
                sums._add(btf, view, block, values, kept, middle)
            progress(1)
        return sums

    def _add(
        self, btf: BTF, view: int, block: slice, values: Tensor, kept: Tensor, middle: Tensor
    ) -> None:
        """Takes in the values `[T, n, C]` of a view under some lights."""
        self.mean[view, block] = values.mean(0, dtype=torch.float64)
        grey = values.mean(-1)  # [T, n]
        self.kept[:, view, block] = grey[kept]
        self.pictures[view] += grey[middle].sum(-1)
        measured = torch.ones(values.shape[1], dtype=torch.bool)
        if btf.missing is not None:
            measured = ~btf.missing[view, block]
        values = values[:, measured]
        if values.numel():
            self._extremes(values)
        if btf.texel_count >= HOT_RANK**2:
            top, texel = grey.topk(HOT_RANK, dim=0)  # [HOT_RANK, n]
            row, light = torch.nonzero(top > HOT_RATIO * top[-1], as_tuple=True)
            places = zip(light.tolist(), texel[row, light].tolist(), strict=True)
            self.hot += [(view, block.start + each, at) for each, at in places if top[-1, each] > 0]

    def _extremes(self, values: Tensor) -> None:
        """Takes in the extremes of values `[T, n, C]`."""
        low, high = map(float, values.aminmax())
        if high > self.highest:
            self.highest, self.at_highest = high, 0
        self.lowest = min(self.lowest, low)
        self.at_highest += int((values == self.highest).sum())
        self.zeros += int((values <= 0.0).sum())
        self.count += values.numel()


def _middle(height: int, width: int) -> Tensor:
    """Texels `[h, w]` of the middle of a picture."""
    rows, columns = min(height, KEPT_SIDE), min(width, KEPT_SIDE)
    row = torch.arange(rows) + (height - rows) // 2
    column = torch.arange(columns) + (width - columns) // 2
    return row[:, None] * width + column
