"""The block of 2 x 2 texels around a place of the texture: the twin of `directions.texel_at`."""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor

from ..geometry.directions import MIRROR, REPEAT, continued
from .libraries import dr, mi


def block_at(uv: Any, rows: int, columns: int, rule: str) -> tuple[Any, list[Any]]:
    """(the first texel of the block around uv, v up, bilinear weights of its four texels)."""
    column, row = uv.x * columns - 0.5, (1.0 - uv.y) * rows - 0.5
    if rule == MIRROR:
        column, row = _mirrored(column, columns), _mirrored(row, rows)
    left, top = dr.floor(column), dr.floor(row)
    right, bottom = column - left, row - top
    if rule == REPEAT:
        left, top = remainder(left, columns), remainder(top, rows)
    # Rounding must not lead beyond the texture.
    block = mi.UInt32(dr.clip(dr.detach(top), 0.0, rows - 1.0)) * columns
    block += mi.UInt32(dr.clip(dr.detach(left), 0.0, columns - 1.0))
    across, down = (1.0 - right, right), (1.0 - bottom, bottom)
    return block, [y * x for y in down for x in across]


def block_corners(rows: int, columns: int, rule: str) -> Tensor:
    """The four texels of every block, in the order of `block_at`: `[T, 4]`."""
    row, column = torch.arange(rows), torch.arange(columns)
    pair = [torch.stack((n, n + 1), dim=1) for n in (row, column)]
    down, across = (continued(p, n, rule) for p, n in zip(pair, (rows, columns), strict=True))
    index = down[:, None, :, None] * columns + across[None, :, None, :]
    return index.reshape(-1, 4)


def remainder(x: Any, count: float) -> Any:
    """x less the greatest multiple of `count` below it."""
    return x - dr.floor(x / count) * count


def _mirrored(at: Any, count: int) -> Any:
    """The place between the first and last centre that looks as `at`."""
    edge = remainder(at + 0.5, 2.0 * count)
    return dr.clip(dr.minimum(edge, 2.0 * count - edge) - 0.5, 0.0, count - 1.0)
