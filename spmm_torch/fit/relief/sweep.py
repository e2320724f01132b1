"""Heights of all texels by a plane sweep [Col96], coarse to fine."""

from __future__ import annotations

import torch
from torch import Tensor

from .pictures import PictureStack
from .resample import resized
from .smooth import lowest, median, smoothed_cost

# Texels of the longer side of the coarsest level at most, on which all candidates are tried.
COARSEST = 96
# Range of heights around the plane that is swept, in texture widths.
REACH = 0.1
# Columns that a step of candidates moves the most grazing view by, at every level.
STEP_TEXELS = 0.65
# Candidates on each side of the heights of the coarser level.
SIDE = 3


def sweep_heights(stack: PictureStack, plane: float, start: Tensor | None = None) -> Tensor:
    """Heights `[H, W]` at which the views agree best, in texture widths.

    Args:
        stack: pictures.
        plane: height of the plane around which the first level searches.
        start: heights `[H, W]` that are refined instead; None: none are known.
    """
    height = start
    for factor, texels in _passes(max(stack.size)):
        level = stack.reduced(factor)
        step = texels / max(float(level.slope.norm(dim=1).max()), 1.0)
        base, side = level.values.new_full(level.size, plane), round(REACH / step)
        if height is not None:
            base, side = resized(height, *level.size, stack.repeats), SIDE
        height = _swept(level, base, step, side, height is not None)
    assert height is not None  # there is at least one pass
    return height


def swept_once(stack: PictureStack) -> Tensor:
    """The same about the plane of the pictures, by one pass at their own size, `[H, W]`."""
    step = STEP_TEXELS / max(float(stack.slope.norm(dim=1).max()), 1.0)
    flat = stack.values.new_zeros(stack.size)
    return _swept(stack, flat, step, round(REACH / step), known=False)


def _passes(side: int) -> list[tuple[int, float]]:
    """Texels of a side that become one, and steps of candidates in texels, from coarse to fine.

    Each pass has half the step of that before it, and there are two at least.
    """
    factors = [1]
    while side / factors[-1] > COARSEST:
        factors.append(2 * factors[-1])
    passes = [(factor, STEP_TEXELS) for factor in factors[::-1]]
    return passes if len(passes) > 1 else [*passes, (1, 0.5 * STEP_TEXELS)]


def _swept(stack: PictureStack, base: Tensor, step: float, side: int, known: bool) -> Tensor:
    """The best of `2 side + 1` heights around `base [H, W]`, a `step` apart, smoothed `[H, W]`."""
    offsets = step * torch.arange(-side, side + 1, device=base.device)
    cost = stack.disagreement(base + offsets[:, None, None])
    index = lowest(smoothed_cost(cost, stack.repeats, known))
    return median(base + step * (index - side), stack.repeats)
