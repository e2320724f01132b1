"""How a texture continues beyond its border.

While heights are sought, steps across the border are held against steps inside. With heights known,
both rules predict what slanted views show beyond the border, and the better one is kept.
"""

from __future__ import annotations

from dataclasses import replace

import torch
from torch import Tensor

from ...geometry.directions import MIRROR, REPEAT, mirrored
from .pictures import PictureStack, added
from .resample import centres, resampled, within

# Steps towards the place that a pixel shows, where heights change along its ray.
PLACE_STEPS = 3
# Mean square of a step across the border over that of steps inside, under which there is no seam:
# in a texture whose neighbours correlate by 0.4, a seam has 1.7.
LEAST_SEAM = 1.7
# Quantile of the steps inside, between all neighbouring rows, that a seam exceeds by a margin:
# threads and joints are steps, too, and may lie at the border.
QUANTILE, MARGIN = 0.95, 1.1


def border_rule(stack: PictureStack) -> str:
    """How the texture continues: "repeat", or "mirror" where left and right, or top and bottom,
    do not fit each other.

    A texture without relation between neighbours has no seam, and repeats.
    """
    steepest = int(stack.slope.norm(dim=1).argmin())
    pictures = stack.values[steepest][stack.weight[steepest] > 0.0]  # [L, H, W]
    seams = _has_seam(pictures) or _has_seam(pictures.transpose(1, 2))
    return MIRROR if seams else REPEAT


def continuation(stack: PictureStack, height: Tensor) -> str:
    """The rule by which pixels that show points beyond the border are predicted better.

    Args:
        stack: pictures.
        height: heights `[H, W]`, in texture widths.
    """
    reference = _reference(replace(stack, repeats=False), height)  # [L, H, W]
    rows, columns = stack.size
    errors = torch.zeros(2, device=height.device)
    for run in stack.runs():
        column, row = _shown(stack, run, height)  # [V, H, W]
        outside = ~within(column, row, rows, columns)[:, None] * stack.weight[run][..., None, None]
        folded = mirrored(column, columns), mirrored(row, rows)
        for rule, (place, repeats) in enumerate((((column, row), True), (folded, False))):
            expected = resampled(reference[None], place[0][None], place[1][None], repeats)[0]
            errors[rule] += (outside * (stack.values[run] - expected).square()).sum()
    return MIRROR if errors[1] < errors[0] else REPEAT


def _reference(stack: PictureStack, height: Tensor) -> Tensor:
    """What all views show of the points of `height [H, W]`, on average, `[L, H, W]`."""
    total, seen = torch.zeros((2, *stack.values.shape[1:]), device=height.device)
    for run in stack.runs():
        values, weight = stack.aligned(run, height[None])
        total += added(weight * values)[0]
        seen += added(weight.expand_as(values))[0]
    return total / seen.clamp(min=torch.finfo(seen.dtype).tiny)


def _shown(stack: PictureStack, run: slice, height: Tensor) -> tuple[Tensor, Tensor]:
    """Columns and rows `[V, H, W]` of the points that the pixels of V views show, about."""
    column, row = centres(*stack.size, height.device)
    # Not read, since the host would wait: [2, V, 1, 1].
    slope, drift = (part[run].T[..., None, None] for part in (stack.slope, stack.drift))
    at, down = (place.expand(slope.shape[1], *stack.size) for place in (column, row))
    for _ in range(PLACE_STEPS):
        here = resampled(height[None, None], at[None], down[None], repeats=False)[0, :, 0]
        at, down = column + here * slope[0] - drift[0], row + here * slope[1] - drift[1]
    return at, down


def _has_seam(pictures: Tensor) -> bool:
    """Whether the last row of `pictures [L, H, W]` is farther from the first than rows inside."""
    if pictures.shape[0] == 0 or pictures.shape[1] < 2:
        return False
    inside = pictures.diff(dim=1).square().mean((0, 2))  # [H - 1]
    across = float((pictures[:, 0] - pictures[:, -1]).square().mean())
    usual = float(inside.quantile(QUANTILE))
    return across > max(LEAST_SEAM * float(inside.mean()), MARGIN * usual)
