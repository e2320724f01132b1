"""The reference plane: the one height at which views agree best over the whole texture."""

from __future__ import annotations

import torch
from torch import Tensor

from .pictures import PictureStack, spread
from .resample import resized
from .smooth import lowest

# Range of the plane, in texture widths: pictures are rectified near the surface, mostly under it.
LOWEST_PLANE, HIGHEST_PLANE = -0.06, 0.16
# Texels at most between what neighbouring candidates show of the most grazing view.
COARSE_STEP = 0.7
# Views in which the plane is sought at most, and texels of a side: all of them tell one number.
MAX_VIEWS, MAX_SIDE = 20, 96
# Finer searches around the best candidate, and candidates on each side of it.
REFINEMENTS, SIDE = 2, 3


def find_plane(stack: PictureStack, relief: Tensor | None = None) -> float:
    """The height of the plane that explains most of the parallax, in texture widths.

    Args:
        stack: pictures.
        relief: heights over that plane, `[H, W]`; None: it is flat.
    """
    steepest = int(stack.slope.norm(dim=1).argmax())
    stack = stack.part(views=spread(stack.slope, min(MAX_VIEWS, len(stack.slope)), steepest))
    stack = stack.reduced(-(-max(stack.size) // MAX_SIDE))
    relief = torch.zeros(stack.size) if relief is None else relief
    relief = resized(relief.to(stack.values.device), *stack.size, stack.repeats)
    greatest = float(stack.slope.norm(dim=1).max())
    count = int((HIGHEST_PLANE - LOWEST_PLANE) * greatest / COARSE_STEP) + 2
    candidates = torch.linspace(LOWEST_PLANE, HIGHEST_PLANE, count)
    step = float(candidates[1] - candidates[0])
    plane = _best(stack, relief, candidates)
    for _ in range(REFINEMENTS):
        step /= SIDE
        plane = _best(stack, relief, plane + step * torch.arange(-SIDE, SIDE + 1))
    return plane


def _best(stack: PictureStack, relief: Tensor, candidates: Tensor) -> float:
    """The plane of least disagreement among evenly spaced `candidates [N]` and between them."""
    heights = relief + candidates.to(relief.device)[:, None, None]
    cost = stack.disagreement(heights).mean((1, 2))
    return float(candidates[0] + lowest(cost).cpu() * (candidates[1] - candidates[0]))
