"""Where the lobes stand that no sample resolves: at the half vectors that were measured.

A lobe narrower than the angle between samples may be known by its tail alone, with a peak of any
height between them. It says the same of the samples where it stands on the half vector of the pair
at which it is seen best, and no more elsewhere.
"""

from __future__ import annotations

from dataclasses import replace

import torch
from torch import Tensor

from ...geometry.directions import half_vectors
from ...lobes.batch import LobeBatch
from ...lobes.grid import DirectionGrid
from ...lobes.sampling import specular_mask
from .peaks import NARROW

# Lobes that are looked at together.
AT_ONCE = 256


def centred(
    lobes: LobeBatch, weights: Tensor, grid: DirectionGrid, resolved: float
) -> tuple[LobeBatch, Tensor]:
    """Lobes of which the narrow ones stand where the samples meet them, as high as there.

    A lobe stays where it is if it is no half-vector lobe, and so would be lower there.

    Args:
        lobes: J lobes.
        weights: of the lobes, `[J, C]`.
        grid: the measured pairs.
        resolved: width of the narrowest lobes that the samples resolve.

    Returns:
        (lobes, weights `[J, C]`) of the same height at that pair.
    """
    narrow = torch.nonzero(specular_mask(lobes, NARROW * resolved) & weights.any(1)).squeeze(1)
    plain, normal, weights = grid.unscaled, lobes.normal.clone(), weights.clone()
    for index in narrow.split(AT_ONCE):
        own = lobes[index]
        before, pair = plain.eval(own).max(1)
        wi, wo = grid.at(pair)
        half = half_vectors(wi, wo)
        moved = replace(own, normal=half)
        after = moved.eval(wi[:, None], wo[:, None]).squeeze(1)
        higher = after >= before
        normal[index] = torch.where(higher[:, None], half, own.normal)
        lowered = before / after.clamp(min=torch.finfo(after.dtype).tiny)
        weights[index] *= torch.where(higher, lowered, 1.0)[:, None]
    return replace(lobes, normal=normal), weights
