"""The texels around a place of the texture: the twin of `directions.texel_at`.

All four of them with their bilinear weights, or one that is drawn by these weights [FWSP23].
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import torch
from torch import Tensor

from ..geometry.directions import MIRROR, REPEAT, continued
from .libraries import dr, mi


def block_at(uv: Any, rows: int, columns: int, rule: str) -> tuple[Any, list[Any]]:
    """(the first texel of the block around uv, v up, bilinear weights of its four texels)."""
    column, row = _centres(uv, rows, columns, rule)
    left, top = dr.floor(column), dr.floor(row)
    right, bottom = column - left, row - top
    across, down = (1.0 - right, right), (1.0 - bottom, bottom)
    return _texel(top, left, rows, columns, rule), [y * x for y in down for x in across]


def texel_drawn(uv: Any, rows: int, columns: int, rule: str, u: Sequence[Any]) -> Any:
    """One of the four texels around uv, v up, drawn by two numbers in [0, 1).

    Its probability is its bilinear weight.
    """
    column, row = _centres(uv, rows, columns, rule)
    return _texel(dr.floor(row + u[1]), dr.floor(column + u[0]), rows, columns, rule)


def _centres(uv: Any, rows: int, columns: int, rule: str) -> tuple[Any, Any]:
    """(column, row) of uv, v up, where whole numbers are centres of texels."""
    column, row = uv.x * columns - 0.5, (1.0 - uv.y) * rows - 0.5
    if rule == MIRROR:
        return _mirrored(column, columns), _mirrored(row, rows)
    return column, row


def _texel(row: Any, column: Any, rows: int, columns: int, rule: str) -> Any:
    """The texel of a row and a column, whole numbers."""
    if rule == REPEAT:
        column, row = remainder(column, columns), remainder(row, rows)
    # Rounding must not lead beyond the texture.
    first = mi.UInt32(dr.clip(dr.detach(row), 0.0, rows - 1.0)) * columns
    return first + mi.UInt32(dr.clip(dr.detach(column), 0.0, columns - 1.0))


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
