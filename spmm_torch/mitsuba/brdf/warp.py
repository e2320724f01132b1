"""Warps of the unit square to directions around +z, the twins of `geometry.warp`, in Dr.Jit."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from ...geometry.warp import COS_FLOOR, SQUARED_RADIUS_FLOOR
from ..libraries import dr, mi
from .base import log1p

TWO_PI = 2.0 * math.pi
# Numbers next to 1, whose logarithm is not finite at 1.
BELOW_ONE = 1.0 - 2.0**-24


def square_to_cosine_hemisphere(u: Sequence[Any]) -> Any:
    """A direction with density cos(theta) / pi, of two numbers in [0, 1)."""
    return from_radius(dr.sqrt(u[0]), dr.sqrt(1.0 - u[0]), TWO_PI * u[1])


def cosine_pdf(w: Any) -> Any:
    """The density of `square_to_cosine_hemisphere`."""
    return dr.maximum(w.z, 0.0) * (1.0 / math.pi)


def square_to_power_cosine(u: Sequence[Any], exponent: Any) -> Any:
    """A direction with density proportional to cos^exponent(theta)."""
    return from_depth(_depth_of_power(u[0], exponent), TWO_PI * u[1])


def power_cosine_pdf(w: Any, exponent: Any) -> Any:
    """The density of `square_to_power_cosine`."""
    density = (exponent + 1.0) * (1.0 / TWO_PI) * dr.exp(exponent * _log_cos_theta(w))
    return dr.select(w.z > 0.0, density, 0.0)


def square_to_beckmann(u: Sequence[Any], alpha_x: Any, alpha_y: Any) -> Any:
    """A microfacet normal of Gaussian slopes."""
    radius = dr.sqrt(-log1p(-dr.minimum(u[0], BELOW_ONE)))
    sine, cosine = dr.sincos(TWO_PI * u[1])
    slope_x, slope_y = alpha_x * radius * cosine, alpha_y * radius * sine
    z = dr.rsqrt(1.0 + slope_x * slope_x + slope_y * slope_y)
    return mi.Vector3f(slope_x * z, slope_y * z, z)


def beckmann_pdf(w: Any, alpha_x: Any, alpha_y: Any) -> Any:
    """The density of `square_to_beckmann`."""
    z = dr.maximum(w.z, COS_FLOOR)
    slope_x, slope_y = w.x / (alpha_x * z), w.y / (alpha_y * z)
    density = dr.exp(-slope_x * slope_x - slope_y * slope_y)
    return dr.select(w.z > 0.0, density / (math.pi * alpha_x * alpha_y * z * z * z), 0.0)


def square_to_ashikhmin_shirley(u: Sequence[Any], exponent_x: Any, exponent_y: Any) -> Any:
    """A half vector of the anisotropic power cosine."""
    sine, cosine = dr.sincos(TWO_PI * u[1])
    x, y = dr.sqrt(exponent_y + 1.0) * cosine, dr.sqrt(exponent_x + 1.0) * sine
    squared = x * x + y * y
    exponent = (exponent_x * x * x + exponent_y * y * y) / squared
    depth, scale = _depth_of_power(u[0], exponent), dr.rsqrt(squared)
    radius = dr.sqrt(depth * (2.0 - depth)) * scale
    return mi.Vector3f(radius * x, radius * y, 1.0 - depth)


def ashikhmin_shirley_pdf(w: Any, exponent_x: Any, exponent_y: Any) -> Any:
    """The density of `square_to_ashikhmin_shirley`."""
    x_squared, y_squared = w.x * w.x, w.y * w.y
    planar = dr.maximum(x_squared + y_squared, SQUARED_RADIUS_FLOOR)
    exponent = (exponent_x * x_squared + exponent_y * y_squared) / planar
    scale = dr.sqrt((exponent_x + 1.0) * (exponent_y + 1.0)) * (1.0 / TWO_PI)
    return dr.select(w.z > 0.0, scale * dr.exp(exponent * _log_cos_theta(w)), 0.0)


def from_depth(depth: Any, phi: Any) -> Any:
    """The unit vector with z = 1 - depth and azimuth phi."""
    return from_radius(dr.sqrt(depth * (2.0 - depth)), 1.0 - depth, phi)


def from_radius(radius: Any, z: Any, phi: Any) -> Any:
    """The vector of a height and, in the plane, a radius and an azimuth."""
    sine, cosine = dr.sincos(phi)
    return mi.Vector3f(radius * cosine, radius * sine, z)


def _depth_of_power(u: Any, exponent: Any) -> Any:
    """1 - cos(theta), without cancellation, of cos(theta) = (1 - u)^(1 / (exponent + 1))."""
    return -_expm1(log1p(-dr.minimum(u, BELOW_ONE)) / (exponent + 1.0))


def _expm1(x: Any) -> Any:
    """exp(x) - 1 without cancellation, for x <= 0 [Kahan]."""
    u = dr.exp(x)
    plain = (u == 1.0) | (u - 1.0 == -1.0)
    safe = dr.select(plain, 0.5, u)
    return dr.select(plain, dr.select(u == 1.0, x, -1.0), (safe - 1.0) * x / dr.log(safe))


def _log_cos_theta(w: Any) -> Any:
    """log(cos(theta)) of a unit vector, accurate near the pole."""
    z = dr.maximum(w.z, COS_FLOOR)
    return -0.5 * log1p((w.x * w.x + w.y * w.y) / (z * z))
