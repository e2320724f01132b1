"""Sampling of visible half vectors in Dr.Jit; `spmm_torch.brdf.visible` tells the theory."""

from __future__ import annotations

from typing import Any

from ...brdf.visible import LENGTH_FLOOR
from ..libraries import dr, mi


def reflect_about_visible(h: Any, wo: Any, u: Any) -> Any:
    """wo mirrored about the half vector h or its counterpart, which the number u decides."""
    planar, upright = h.x * wo.x + h.y * wo.y, h.z * wo.z
    own, other = dr.maximum(upright + planar, 0.0), dr.maximum(upright - planar, 0.0)
    sign = dr.select(u * (own + other) < own, 1.0, -1.0)
    twice = 2.0 * (upright + sign * planar)
    return mi.Vector3f(twice * sign * h.x, twice * sign * h.y, twice * h.z) - wo


def unit_half_vector(wi: Any, wo: Any) -> Any:
    """The unit half vector of wi and wo; 0 where they are opposite."""
    h = wi + wo
    return h / dr.maximum(dr.norm(h), LENGTH_FLOOR)


def visible_pdf(density: Any, h: Any, wo: Any) -> Any:
    """pdf(wi) in 1/sr of a density of the unit half vector h of wi and wo."""
    widest = dr.maximum(dr.dot(h, wo), 2.0 * h.z * wo.z)
    return density / (2.0 * dr.maximum(widest, LENGTH_FLOOR))
