"""Selections that are drawn: rectangles by dragging, and any shape by painting."""

from __future__ import annotations

import hashlib
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from ...edit import Rectangle
from ...edit.masks.picture import PictureMask

Point = tuple[float, float]  # from the left and from the top of the texture, each 0 to 1


def rectangle_between(first: Point, second: Point, height: int, width: int) -> Rectangle:
    """The rectangle of texels that two corners touch."""
    columns = sorted(_place(point[0], width) for point in (first, second))
    rows = sorted(_place(point[1], height) for point in (first, second))
    return Rectangle(columns[0], rows[0], columns[1] - columns[0] + 1, rows[1] - rows[0] + 1)


def texel_under(point: Point, height: int, width: int) -> int:
    """The texel at a point."""
    return _place(point[1], height) * width + _place(point[0], width)


def painted(
    mask: NDArray[np.float32], at: Point, radius: float, erase: bool
) -> NDArray[np.float32]:
    """A mask `[H, W]` with a soft disk painted, or erased.

    Args:
        mask: selected fraction of each texel, 0 to 1.
        at: middle of the disk.
        radius: in texture widths; the edge fades over a texel.
        erase: remove the disk instead of adding it.
    """
    height, width = mask.shape
    rows, columns = np.mgrid[0:height, 0:width] + 0.5
    distance = np.hypot(columns - at[0] * width, rows - at[1] * height)
    disk = np.clip(radius * width - distance + 0.5, 0.0, 1.0).astype(np.float32)
    return np.minimum(mask, 1.0 - disk) if erase else np.maximum(mask, disk)


def picture_mask(mask: NDArray[np.float32], folder: Path) -> PictureMask:
    """A mask for scripts, whose picture is saved in `folder` and named by its hash."""
    codes = np.round(mask * 255.0).astype(np.uint8)
    name = hashlib.sha256(codes.tobytes()).hexdigest()[:12]
    path = folder / f"painted_{name}.png"
    if not path.is_file():
        Image.fromarray(codes).save(path, "PNG")
    return PictureMask(str(path))


def _place(part: float, count: int) -> int:
    return min(max(int(part * count), 0), count - 1)
