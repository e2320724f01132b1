"""Peaks that are narrower than the measured directions.

A lobe is at least as wide as a share of the angle between directions, since samples hold no more.
Where a peak is so narrow that the samples beside it contradict even that, its width is unknown, but
not its energy: an unresolved peak is the mirror image that a smooth surface gives, of which
Fresnel's law says how much it reflects. It reflects more at grazing angles where the surface is a
dielectric (F0 about 0.04), and as much at all angles where it is a metal [NDM05]. A lobe of width w
and height D F / (4 cos_theta_o) reflects F, with D = 1 / (pi w^2) at the mirror direction.

References:
    [NDM05] Addy Ngan, Fredo Durand, Wojciech Matusik, Experimental Analysis of BRDF Models,
        Eurographics Symposium on Rendering, 2005.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor

from ...geometry.directions import half_vectors
from ...lobes.grid import DirectionGrid

# Reflectance along the normal of dielectrics (index 1.5) and of bright metals.
DIELECTRIC, METAL = 0.04, 0.9
# A peak whose height times cosine rises by this factor towards grazing angles is a dielectric's.
RISE = 1.5
# Angles of incidence that are far from grazing, and near it.
STEEP, GRAZING = math.radians(50.0), math.radians(65.0)
# Pairs whose half vector is as near as this to that of the peak belong to it, in least widths.
SAME = 0.5
# The half vectors next to it are as far as the nearest one, times this.
BESIDE = 1.3
# Lobes are unresolved if they are narrower than the resolved width times this.
NARROW = 0.9
# Least width of all: narrower than any measurement.
NARROWEST = 0.004


@dataclass(frozen=True)
class Unresolved:
    """Peaks that are narrower than the measured directions.

    Attributes:
        width: of lobes that have the height of the peaks and reflect what the surface does.
        reflectance: of the surface along its normal.
        metal: whether it reflects as much at all angles.
    """

    width: float
    reflectance: float
    metal: bool


def unresolved(grid: DirectionGrid, values: Tensor, width: float) -> Unresolved | None:
    """The narrowest peaks of samples; None if lobes of `width` resolve all.

    Args:
        grid: the measured pairs.
        values: of the samples without weights, `[S, C, D]`.
        width: of the narrowest lobes that samples resolve, as a slope.
    """
    wi, wo = grid.at(torch.arange(grid.pair_count, device=grid.light.device))
    half = _half_vectors(grid)
    incidence = torch.arccos((half * wi).sum(-1).clamp(-1.0, 1.0))
    found = [_of_sample(value * wo[:, 2], half, incidence, width) for value in values]
    return min((one for one in found if one is not None), key=lambda one: one.width, default=None)


def peak_pairs(grid: DirectionGrid, width: float) -> Tensor:
    """True `[D]` at pairs whose half vector is the normal, or as good as that."""
    slope = torch.tan(torch.arccos(_half_vectors(grid)[:, 2].clamp(-1.0, 1.0)))
    return slope < SAME * width


def _half_vectors(grid: DirectionGrid) -> Tensor:
    """Half vectors of all pairs, `[D, 3]`."""
    wi, wo = grid.at(torch.arange(grid.pair_count, device=grid.light.device))
    return half_vectors(wi, wo)


def _of_sample(value: Tensor, half: Tensor, incidence: Tensor, width: float) -> Unresolved | None:
    """The peak of one sample.

    Args:
        value: times the cosine of the view, `[C, D]`.
        half: half vectors `[D, 3]`.
        incidence: angle between light and half vector, `[D]`.
        width: of the narrowest lobes that samples resolve.
    """
    mean = value.mean(0)
    slope = torch.tan(torch.arccos((half @ half[int(mean.argmax())]).clamp(-1.0, 1.0)).abs())
    own = slope < SAME * width
    steep, grazing = own & (incidence < STEEP), own & (incidence > GRAZING)
    others = ~own & (incidence < STEEP)
    if not (bool(steep.any()) and bool(others.any())):
        return None
    beside = others & (slope < BESIDE * slope[others].min())
    height = float(mean[steep].median())
    lobe = torch.exp(-((slope[beside] / width) ** 2))
    if float((mean[beside]).median()) > height * float(lobe.median()):
        return None
    metal = not bool(grazing.any()) or float(mean[grazing].median()) < RISE * height
    if metal:
        height = float(value[:, steep].median(1).values.max())
    if not height > 0.0:  # noise that is kept below zero
        return None
    reflectance = METAL if metal else DIELECTRIC
    narrow = max(NARROWEST, math.sqrt(reflectance / (4.0 * math.pi * height)))
    return Unresolved(narrow, reflectance, metal) if narrow < width else None
