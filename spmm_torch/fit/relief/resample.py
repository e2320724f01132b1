"""Pictures read between their texels, beyond their border by a rule."""

from __future__ import annotations

import torch
from torch import Tensor
from torch.nn import functional

# Texels around a picture that repeats, so that bilinear lookups never leave it.
MARGIN = 1


def centres(height: int, width: int, device: torch.device | str = "cpu") -> tuple[Tensor, Tensor]:
    """Columns and rows `[H, W]` of all texel centres, from 0."""
    row = torch.arange(height, dtype=torch.float32, device=device)
    column = torch.arange(width, dtype=torch.float32, device=device)
    rows, columns = torch.meshgrid(row, column, indexing="ij")
    return columns, rows


def resampled(pictures: Tensor, column: Tensor, row: Tensor, repeats: bool) -> Tensor:
    """Values `[V, N, L, h, w]` of `pictures [V, L, H, W]`, bilinear, at places `[V, N, h, w]`.

    Args:
        pictures: L pictures of each view.
        column, row: places, from 0 at the centre of the texel at the top left.
        repeats: whether pictures repeat; else their border goes on.
    """
    views, count, rows, columns = column.shape
    height, width = pictures.shape[-2:]
    if repeats:
        pictures = functional.pad(pictures, (MARGIN,) * 4, mode="circular")
        column, row = column.remainder(width) + MARGIN, row.remainder(height) + MARGIN
    scale = [2.0 / max(size - 1, 1) for size in pictures.shape[-2:]]
    place = torch.stack((column * scale[1] - 1.0, row * scale[0] - 1.0), dim=-1)
    values = functional.grid_sample(
        pictures,
        place.view(views, count * rows, columns, 2),
        mode="bilinear",
        padding_mode="border",
        align_corners=True,
    )
    return values.unflatten(2, (count, rows)).transpose(1, 2)


def within(column: Tensor, row: Tensor, height: int, width: int) -> Tensor:
    """Whether places `[...]` lie within pictures of this size, `[...]` bool."""
    across = (column > -0.5) & (column < width - 0.5)
    return across & (row > -0.5) & (row < height - 0.5)


def resized(picture: Tensor, height: int, width: int, repeats: bool) -> Tensor:
    """A `picture [H, W]` read at the centres of a grid of another size, `[height, width]`."""
    column, row = centres(height, width, picture.device)
    column = (column + 0.5) * (picture.shape[1] / width) - 0.5
    row = (row + 0.5) * (picture.shape[0] / height) - 0.5
    return resampled(picture[None, None], column[None, None], row[None, None], repeats)[0, 0, 0]


def padded(pictures: Tensor, margin: int, repeats: bool) -> Tensor:
    """Pictures `[N, H, W]` with `margin` texels more on each side, by the rule."""
    mode = "circular" if repeats else "replicate"
    return functional.pad(pictures[None], (margin,) * 4, mode=mode)[0]
