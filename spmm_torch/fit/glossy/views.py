"""Squared errors relative to the energy of their view and of their light.

Mirror peaks at grazing angles may be a hundred times as high as those along the normal. Plain
squared errors see that one ring of samples alone: lobes meet it to a hundredth and the next one to
a fifth, and how a peak rises from one to the other, all that tells of what lies between, is lost.
Relative to their view and light, all peaks count alike.
"""

from __future__ import annotations

import torch
from torch import Tensor

# Name of these errors in reports.
BY_VIEW = "by-view"
# Energy of a view or a light relative to that of the brightest, under which it counts as black.
LEAST_ENERGY = 1e-6


def view_weights(size: Tensor, measured: Tensor, views: int) -> Tensor:
    """Weights of pairs `[D]`: 1 / sqrt(energy of the view times that of the light).

    Args:
        size: mean values of the pairs, 0 where not measured, `[D]`.
        measured: `[D]` bool.
        views: their number V.
    """
    energy, count = size.square().view(views, -1), measured.view(views, -1)
    of_view, of_light = (_energies(energy.sum(axis), count.sum(axis)) for axis in (1, 0))
    return (of_view[:, None] * of_light).rsqrt().flatten()


def _energies(total: Tensor, count: Tensor) -> Tensor:
    """Mean energies `[N]` of totals over so many pairs, none of them black."""
    mean = total / count.clamp(min=1)
    floor = LEAST_ENERGY * float(mean.max())
    return mean.clamp(min=floor) if floor > 0.0 else torch.ones_like(mean)
