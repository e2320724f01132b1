"""Sampling of visible half vectors, for every BRDF that is a lobe of the half vector h.

Microfacets in V-grooves come in pairs, h = (x, y, z) and h' = (-x, -y, z). Of a pair that is drawn
from a density p_h of half vectors, one facet is chosen in proportion to its visible area <h.wo>.
This gives exactly the distribution of visible normals of the V-groove model [Heitz and d'Eon 2014],
which Cook-Torrance has; for other BRDFs it is a sampler that never draws a half vector that faces
away. With wi the mirror image of wo about h,

    pdf(wi) = p_h(h) / (2 max(h.wo, 2 (n.h)(n.wo))).

It holds for every p_h that is the same at h and h', and for wo above the horizon.

Source: E. Heitz, E. d'Eon, Importance Sampling Microfacet-Based BSDFs using the Distribution of
Visible Normals, Computer Graphics Forum 33(4), 103-112, 2014.
"""

from __future__ import annotations

import torch
from torch import Tensor

# Least length of wi + wo: the direction of a shorter one is rounding. Then wi is under the horizon,
# or both are within a thousandth of a degree of it.
LENGTH_FLOOR = 1e-6


def reflect_about_visible(h: Tensor, wo: Tensor, u: Tensor) -> Tensor:
    """wi `[..., 3]`: wo mirrored about h or h', which `u [...]` in [0, 1) decides.

    Args:
        h: unit half vectors `[..., 3]` drawn from p_h.
        wo: unit views above the horizon, `[..., 3]`.
        u: uniform numbers `[...]`.
    """
    planar = h[..., 0] * wo[..., 0] + h[..., 1] * wo[..., 1]
    upright = h[..., 2] * wo[..., 2]
    own, other = (upright + planar).clamp(min=0.0), (upright - planar).clamp(min=0.0)
    sign = torch.where(u * (own + other) < own, 1.0, -1.0).to(h.dtype)
    cos_theta_d = upright + sign * planar
    taken = torch.stack((sign * h[..., 0], sign * h[..., 1], h[..., 2].expand(sign.shape)), dim=-1)
    return 2.0 * cos_theta_d[..., None] * taken - wo


def unit_half_vector(wi: Tensor, wo: Tensor) -> Tensor:
    """The unit half vector `[..., 3]` of wi and wo; 0 where they are opposite."""
    x, y, z = (wi + wo).unbind(-1)
    length = torch.sqrt(x * x + y * y + z * z).clamp(min=LENGTH_FLOOR)
    return torch.stack((x / length, y / length, z / length)).movedim(0, -1)


def visible_pdf(density: Tensor, h: Tensor, wo: Tensor) -> Tensor:
    """pdf(wi) in 1/sr `[...]` of p_h(h) = `density [...]`, h the unit half vector of wi and wo."""
    cos_theta_d = (h * wo).sum(dim=-1)
    widest = torch.maximum(cos_theta_d, 2.0 * h[..., 2] * wo[..., 2])
    return density / (2.0 * widest.clamp(min=LENGTH_FLOOR))
