"""The look of one region of a texture, copied to another."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from ...config.schema import REQUIRED, setting
from ...lobes.ragged import ranges
from ...model.lookup import SparseWeights
from ...model.spmm import SPMM
from ..masks.rectangle import Rectangle, bounds
from ..parts import with_parts
from ..selection import EVERYTHING, Selection
from .blend import blend


@dataclass(frozen=True)
class CopyLook:
    """The look of a rectangle, repeated over the mask."""

    x: int = setting(REQUIRED, "the leftmost column to copy from", low=0)
    y: int = setting(REQUIRED, "the topmost row to copy from", low=0)
    width: int = setting(REQUIRED, "number of columns", low=1)
    height: int = setting(REQUIRED, "number of rows", low=1)

    def apply(self, model: SPMM, where: Selection) -> SPMM:
        """The edited model."""
        return copy_look(model, Rectangle(self.x, self.y, self.width, self.height), where)


@torch.no_grad()
def copy_look(model: SPMM, source: Rectangle, where: Selection = EVERYTHING) -> SPMM:
    """Gives the selected texels the look of a region, which is repeated over them as tiles.

    The region's top left corner comes to that of the selection. Soft shares blend; lobes and the
    residual are treated as by `blend`.

    Args:
        model: the original.
        source: the region.
        where: whole texels that are overwritten.

    Raises:
        ConfigError: the region reaches out of the texture, or a selection of some lobes.
    """
    source.check(model)
    share = where.texel_share(model, "copying a look")
    if not bool((share > 0.0).any()):
        return model
    target = bounds(share.view(model.height, model.width) > 0.0)
    rows, columns = (torch.arange(n, device=share.device) for n in (model.height, model.width))
    row = source.y + (rows - target.y) % source.height
    column = source.x + (columns - target.x) % source.width
    origin = (row[:, None] * model.width + column).flatten()
    return blend(model, rearranged(model, origin), 1.0, where)


def rearranged(model: SPMM, origin: Tensor) -> SPMM:
    """The model whose texel t is the texel `origin[t]` of another.

    Args:
        model: the other one.
        origin: a texel for each of its T texels, `[T]` long.
    """
    count = model.lobe_count_per_texel()[origin]
    offset = torch.cat((count.new_zeros(1), count.cumsum(0)))
    _, entry = ranges(model.offset[origin], count)
    index, weight = (each.index_select(0, entry) for each in (model.index, model.weight.detach()))
    weights = SparseWeights(offset, index, weight)
    components, relief = model.components, model.relief
    if components is not None:
        components = components.with_codes(coefficient=components.coefficient.detach()[origin])
    if relief is not None:
        relief = relief.with_heights(relief.heights(model.texel_count)[origin])
    labels = model.labels[origin]
    return with_parts(model, weights=weights, labels=labels, components=components, relief=relief)
