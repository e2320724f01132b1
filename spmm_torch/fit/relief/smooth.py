"""The smoothest heights that the agreement of views allows: semi-global matching [Hir08].

The minimum alone of each texel is wild where the texture is flat or repeats. Paths from four sides
carry what their texels agree on to those that cannot tell.
"""

from __future__ import annotations

import torch
from torch import Tensor

from .resample import padded

# Penalties of a step by one candidate between neighbours, and of a jump: variances of pictures of
# variance 1. On four path-traced materials half or twice as much changes under 0.1 dB on three.
STEP, JUMP = 0.05, 0.2
# The same between corrections of heights that are smooth already: less, since penalties flatten.
KNOWN_STEP, KNOWN_JUMP = 0.02, 0.1
# Texels before the border from which paths start where the texture repeats.
RUN_UP = 16


def smoothed_cost(cost: Tensor, repeats: bool, known: bool = False) -> Tensor:
    """Cost of candidates with that of smooth paths to each texel added, `[N, H, W]`.

    Args:
        cost: cost of each candidate, rising heights, at each texel, `[N, H, W]`.
        repeats: whether the texture repeats, so that paths go on over the border.
        known: whether candidates lie around heights that are smooth already.
    """
    step, jump = (KNOWN_STEP, KNOWN_JUMP) if known else (STEP, JUMP)
    sides = [cost, cost.transpose(1, 2)]
    square = cost.shape[1] == cost.shape[2]
    found = []
    for some in [sides] if square else [[side] for side in sides]:  # all in one loop where it fits
        ways = torch.stack([way for side in some for way in (side, side.flip(1))], dim=1)
        paths = _paths(ways, repeats, step, jump)
        found += [down + up.flip(1) for down, up in zip(paths[::2], paths[1::2], strict=True)]
    return found[0] + found[1].transpose(1, 2)


def _paths(cost: Tensor, repeats: bool, step: float, jump: float) -> Tensor:
    """Costs `[B, N, H, W]` of the best paths from row 0, given `cost [N, B, H, W]` [Hir08]."""
    rows = cost.shape[2]
    start = -min(RUN_UP, rows) if repeats else 0
    path, kept = cost[:, :, start], []
    walled = cost.new_full((len(cost) + 2, *path.shape[1:]), float("inf"))
    above = walled[1:-1]  # costs of the row before, over its least, between two walls
    for row in range(start, rows):
        torch.sub(path, path.amin(0, keepdim=True), out=above)
        near = torch.minimum(above, torch.minimum(walled[2:], walled[:-2]) + step)
        path = cost[:, :, row] + near.clamp(max=jump)
        if row >= 0:
            kept.append(path)
    return torch.stack(kept, dim=2).transpose(0, 1)


def lowest(cost: Tensor) -> Tensor:
    """Where the cost `[N, ...]` is lowest along N, by a parabola through three candidates, `[...]`.

    The result counts candidates from 0; at the ends it is whole.
    """
    last = len(cost) - 1
    index = cost.argmin(0)
    middle = index.clamp(1, max(last - 1, 1))[None]
    low, mid, high = (cost.gather(0, (middle + k).clamp(0, last))[0] for k in (-1, 0, 1))
    bend = low - 2.0 * mid + high
    step = 0.5 * (low - high) / bend.clamp(min=torch.finfo(cost.dtype).eps)
    inner = (index > 0) & (index < last)
    return index + torch.where(inner, step.clamp(-0.5, 0.5), torch.zeros_like(step))


def median(height: Tensor, repeats: bool) -> Tensor:
    """The median of 3 x 3 texels at each texel of `height [H, W]`."""
    around = padded(height[None], 1, repeats)[0].unfold(0, 3, 1).unfold(1, 3, 1)  # [H, W, 3, 3]
    return around.flatten(2).median(2).values
