"""Reflected energy: the sum of values over the hemisphere of lights, view by view."""

from __future__ import annotations

import torch
from scipy.spatial import KDTree
from torch import Tensor

from ..geometry.directions import hemisphere_spiral
from ..geometry.grazing import lowest_cosine

# Directions that the hemisphere is divided by, evenly.
POINTS = 20_000
QUARTER_TURN = torch.pi / 2.0


def solid_angles(light: Tensor) -> Tensor:
    """Solid angles `[L]` that lights `[L, 3]` stand for, in sr: of the points nearest to each.

    Points count by their cosine over that of the light, as values hold it.
    """
    point = hemisphere_spiral(POINTS, QUARTER_TURN).double()
    nearest = torch.from_numpy(KDTree(light.double().numpy()).query(point.numpy())[1])
    cosine = light[:, 2].double().clamp(min=lowest_cosine(light))
    total = torch.zeros(len(light), dtype=torch.float64).index_add(0, nearest, point[:, 2])
    return total / cosine * (2.0 * torch.pi / POINTS)


def reflectance(mean: Tensor, light: Tensor, measured: Tensor) -> Tensor:
    """White-sky reflectance `[V, C]`: the share of even light that each view gets back.

    Args:
        mean: mean values `[V, L, C]`, with the cosine of the light.
        light: unit vectors `[L, 3]`.
        measured: pairs that have values, `[V, L]` bool; the others take the mean of these.
    """
    area = solid_angles(light) * measured  # [V, L]
    whole = solid_angles(light).sum()
    scale = whole / area.sum(1, keepdim=True).clamp(min=torch.finfo(torch.float64).tiny)
    return torch.einsum("vl,vlc->vc", area * scale, mean.double())
