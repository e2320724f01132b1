"""The sharpest peaks of some texels, against the spacing of the lights that sample them."""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor

from ..geometry.directions import angular_spacing

# A peak stands this many times over the median of its view, and within this angle of the mirror.
PEAK_RATIO, MIRROR_CHORD = 4.0, 0.7
# Lights within this many spacings of the brightest are its neighbours.
NEAR = 1.6


@dataclass(frozen=True)
class Peaks:
    """The peaks of a BTF.

    Attributes:
        spacing: angle between neighbouring lights, in radians.
        share: share of (texel, view) that have a peak.
        half_width: median angle at which a peak is half as high, in radians; None: no peaks.
    """

    spacing: float
    share: float
    half_width: float | None


def peaks(kept: Tensor, light: Tensor, view: Tensor) -> Peaks:
    """The peaks of some texels.

    Args:
        kept: values `[S, V, L]` with the cosine of the light.
        light, view: unit vectors `[L, 3]`, `[V, 3]`.
    """
    spacing = angular_spacing(light)
    cosine = light[:, 2].clamp(min=1e-2)
    seen = (view[:, 2] > 0.5) & (light[:, 2] > 0.2).any()
    brdf = (kept / cosine)[:, seen][..., light[:, 2] > 0.2]  # [S, v, l]
    light = light[light[:, 2] > 0.2]
    if brdf.numel() == 0 or len(light) < 8:
        return Peaks(spacing, 0.0, None)
    height, at = brdf.max(-1)  # [S, v]
    base = brdf.median(-1).values
    mirror = view[seen] * torch.tensor([-1.0, -1.0, 1.0])
    close = (light[at] - mirror).norm(dim=-1) < MIRROR_CHORD
    found = close & (height > PEAK_RATIO * base.clamp(min=0.0)) & (height > 0.0)
    if not bool(found.any()):
        return Peaks(spacing, 0.0, None)
    # By products, a light would be some 1e-4 from itself, and its own neighbour.
    exact = "donot_use_mm_for_euclid_dist"
    apart = torch.cdist(light[at[found]], light, compute_mode=exact)  # [peaks, l]
    near = (apart < NEAR * spacing) & (apart > 0.0)
    beside = torch.where(near, brdf[found], -torch.inf).amax(-1)
    distance = torch.where(near, apart, torch.inf).amin(-1)
    beside = torch.where(beside.isfinite(), beside, base[found])
    left = (beside - base[found]).clamp(min=1e-6 * height[found])
    fall = ((height[found] - base[found]) / left).clamp(min=1.0 + 1e-6)
    width = distance.clamp(max=spacing * NEAR) / (fall.log() / math.log(2.0)).sqrt()
    return Peaks(spacing, float(found.float().mean()), float(width.median()))
