"""Directions below the lowest measured ones.

Of light nothing is known there but that values end at the horizon. A view of a relief shows there
what the lowest measured view shows: lobes that lean away would end one by one, as a dark seam along
the outline of every body.
"""

from __future__ import annotations

import torch
from torch import Tensor

# Least cosine of the lowest measured direction, which cosines are divided by: it may be 0.
LOWEST_COSINE = 1e-6


def lowest_cosine(directions: Tensor) -> float:
    """z of the lowest of measured directions `[N, 3]`, at least LOWEST_COSINE."""
    return max(float(directions[:, 2].min()), LOWEST_COSINE)


def grazing_fade(cosine: Tensor, lowest: float) -> Tensor:
    """min(1, cosine / lowest) `[...]`, by which values below the lowest measured light fade.

    Args:
        cosine: z of lights, `[...]`; those under the horizon fade to 0.
        lowest: z of the lowest measured light; see `lowest_cosine`.
    """
    return (cosine / lowest).clamp(0.0, 1.0)


def held_view(wo: Tensor, lowest: float) -> Tensor:
    """Views `[..., 3]`, those below the lowest measured one turned up to it.

    Args:
        wo: unit vectors `[..., 3]`; those under the horizon stay there.
        lowest: z of the lowest measured view; see `lowest_cosine`.
    """
    planar, z = wo[..., :2], wo[..., 2:]
    # A view along z, which stays, has no azimuth and no gradient of one.
    length = planar.square().sum(-1, keepdim=True).clamp(min=torch.finfo(wo.dtype).tiny).sqrt()
    turned = torch.cat(
        ((1.0 - lowest * lowest) ** 0.5 / length * planar, torch.full_like(z, lowest)), dim=-1
    )
    return torch.where((z > 0.0) & (z < lowest), turned, wo)
