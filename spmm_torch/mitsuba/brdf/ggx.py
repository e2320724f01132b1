"""GGX in Dr.Jit."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from ...brdf.ggx import LENGTH_FLOOR
from ..libraries import dr, mi
from .base import INV_PI, Kappa, Twin, guarded_cosines, half_vector, schlick_fresnel
from .visible import unit_half_vector


def _eval(kappa: Kappa, wi: Any, wo: Any) -> Any:
    alpha_x, alpha_y, f0 = kappa
    cos_theta_i, cos_theta_o = guarded_cosines(wi, wo)
    h = half_vector(wi, wo)
    spread = h.x_squared / (alpha_x * alpha_x) + h.y_squared / (alpha_y * alpha_y) + h.z * h.z
    peak = h.length_squared / spread
    length_i = dr.norm(mi.Vector3f(alpha_x * wi.x, alpha_y * wi.y, cos_theta_i))
    length_o = dr.norm(mi.Vector3f(alpha_x * wo.x, alpha_y * wo.y, cos_theta_o))
    masking = 0.5 / (cos_theta_o * length_i + cos_theta_i * length_o)
    fresnel = schlick_fresnel(f0, h.cos_theta_d)
    return INV_PI / (alpha_x * alpha_y) * peak * peak * masking * fresnel


def _sample(kappa: Kappa, wo: Any, u: Sequence[Any]) -> Any:
    view = _unit(_stretched(kappa, wo))
    drop = u[2] * (1.0 + view.z)
    radius = dr.sqrt(dr.maximum(drop * (2.0 - drop), 0.0))
    sine, cosine = dr.sincos(2.0 * math.pi * u[1])
    cap = mi.Vector3f(
        view.x + radius * cosine, view.y + radius * sine, (1.0 + view.z) * (1.0 - u[2])
    )
    h = _unit(_stretched(kappa, cap))
    return 2.0 * dr.dot(h, wo) * h - wo


def _pdf(kappa: Kappa, wi: Any, wo: Any) -> Any:
    alpha_x, alpha_y = kappa[0], kappa[1]
    h = unit_half_vector(wi, wo)
    x, y = h.x / alpha_x, h.y / alpha_y
    spread = dr.maximum(x * x + y * y + h.z * h.z, 1.0)
    density = INV_PI / (alpha_x * alpha_y * spread * spread)
    length_o = dr.norm(_stretched(kappa, wo))
    return dr.select(h.z > 0.0, density / (2.0 * (wo.z + length_o)), 0.0)


def _stretched(kappa: Kappa, w: Any) -> Any:
    """Vectors of a hemisphere stretched to those of any alpha."""
    return mi.Vector3f(kappa[0] * w.x, kappa[1] * w.y, w.z)


def _unit(w: Any) -> Any:
    return w / dr.maximum(dr.norm(w), LENGTH_FLOOR)


GGX = Twin(_eval, _sample, _pdf)
