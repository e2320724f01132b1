"""Heights refined with a model as the reference: what it predicts, against what views show."""

from __future__ import annotations

from collections.abc import Callable

import torch
from torch import Tensor

from .pictures import PictureStack
from .smooth import lowest, median, smoothed_cost
from .sweep import STEP_TEXELS

# Candidates on each side of the present heights.
SIDE = 4


def refined_height(
    stack: PictureStack, height: Tensor, predicted: Callable[[int], Tensor]
) -> Tensor:
    """Heights `[H, W]` near `height [H, W]` at which the views show best what a model predicts.

    Args:
        stack: pictures; their normalization is taken off again by fitting each picture's scale.
        height: present heights, in texture widths.
        predicted: values `[L, H, W]` of all texels under one view of the stack, as
            `pictures.logarithms` of the model's own.
    """
    step = 0.5 * STEP_TEXELS / float(stack.slope.norm(dim=1).max())
    offsets = step * torch.arange(-SIDE, SIDE + 1, device=height.device)
    candidates = height + offsets[:, None, None]
    cost, seen = torch.zeros_like(candidates), torch.zeros_like(candidates)
    for view in range(len(stack.values)):
        values, weight = stack.aligned(view, candidates)
        now, known = stack.aligned(view, height[None])
        expected = _matched(predicted(view), now[0], known[0].expand_as(now[0]))
        cost += (weight * (values - expected).square()).sum(1)
        seen += weight.expand_as(values).sum(1)
    least = torch.finfo(cost.dtype).tiny
    mean = torch.where(seen > 0.0, cost / seen.clamp(min=least), torch.ones_like(cost))
    index = lowest(smoothed_cost(mean, stack.repeats, known=True))
    return median(height + step * (index - SIDE), stack.repeats)


def _matched(values: Tensor, target: Tensor, weight: Tensor) -> Tensor:
    """`values [L, H, W]`, scaled and moved to least squares of `target [L, H, W]` in each picture.

    Args:
        values, target: pictures.
        weight: weight of each texel, `[L, H, W]`.
    """
    total = weight.sum((1, 2), keepdim=True).clamp(min=1e-12)
    mean, aim = ((weight * each).sum((1, 2), keepdim=True) / total for each in (values, target))
    centred = values - mean
    spread = (weight * centred.square()).sum((1, 2), keepdim=True).clamp(min=1e-12)
    gain = (weight * centred * (target - aim)).sum((1, 2), keepdim=True) / spread
    return aim + gain * centred
