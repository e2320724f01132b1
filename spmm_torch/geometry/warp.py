"""Warps of the unit square to directions, each with the density of its directions.

`square_to_x(u, ...)` maps points `u [..., 2]` of [0, 1)^2 to unit vectors `[..., 3]` around +z.
`square_to_x_pdf(w, ...)` is its density `[...]` at unit vectors `w [..., 3]`, in 1/sr: defined over
the whole sphere, and 0 below the horizon. Parameters `[...]` broadcast.
"""

from __future__ import annotations

import math

import torch
from torch import Tensor

# Smallest divisor among cosines; its cube is still a normal float32.
COS_FLOOR = 1e-6
# Smallest divisor among squared lengths in the plane.
SQUARED_RADIUS_FLOOR = 1e-12


def square_to_cosine_hemisphere(u: Tensor) -> Tensor:
    """Directions `[..., 3]` with density proportional to cos(theta), by Malley's method."""
    radius, z = torch.sqrt(u[..., 0]), torch.sqrt(1.0 - u[..., 0])
    phi = 2.0 * math.pi * u[..., 1]
    return torch.stack((radius * torch.cos(phi), radius * torch.sin(phi), z), dim=-1)


def square_to_cosine_hemisphere_pdf(w: Tensor) -> Tensor:
    """The density `[...]` of `square_to_cosine_hemisphere`: cos(theta) / pi."""
    return w[..., 2].clamp(min=0.0) / math.pi


def square_to_uniform_hemisphere(u: Tensor) -> Tensor:
    """Directions `[..., 3]` uniform by solid angle."""
    return _from_depth(u[..., 0], 2.0 * math.pi * u[..., 1])


def square_to_uniform_hemisphere_pdf(w: Tensor) -> Tensor:
    """The density `[...]` of `square_to_uniform_hemisphere`: 1 / (2 pi)."""
    return (w[..., 2] >= 0.0).to(w.dtype) / (2.0 * math.pi)


def square_to_power_cosine(u: Tensor, exponent: Tensor) -> Tensor:
    """Directions `[..., 3]` with density proportional to cos^exponent(theta), exponent > -1."""
    return _from_depth(_depth_of_power(u[..., 0], exponent), 2.0 * math.pi * u[..., 1])


def square_to_power_cosine_pdf(w: Tensor, exponent: Tensor) -> Tensor:
    """The density `[...]` of `square_to_power_cosine`.

    It is (exponent + 1) / (2 pi) cos^exponent(theta).
    """
    density = (exponent + 1.0) / (2.0 * math.pi) * torch.exp(exponent * _log_cos_theta(w))
    return density * (w[..., 2] > 0.0)


def square_to_beckmann(u: Tensor, alpha_x: Tensor, alpha_y: Tensor) -> Tensor:
    """Microfacet normals `[..., 3]` of Gaussian slopes with roughness alpha_x and alpha_y.

    The same as for Ward's half vectors [Walter 2005], and as [Walter et al. 2007, Eq. 28, 29] for
    alpha_x = alpha_y.
    """
    radius = torch.sqrt(-torch.log1p(-u[..., 0]))
    phi = 2.0 * math.pi * u[..., 1]
    slope_x, slope_y = alpha_x * radius * torch.cos(phi), alpha_y * radius * torch.sin(phi)
    z = torch.rsqrt(1.0 + slope_x * slope_x + slope_y * slope_y)
    return torch.stack((slope_x * z, slope_y * z, z), dim=-1)


def square_to_beckmann_pdf(w: Tensor, alpha_x: Tensor, alpha_y: Tensor) -> Tensor:
    """The density `[...]` of `square_to_beckmann`.

    It is exp(-(slope_x / alpha_x)^2 - (slope_y / alpha_y)^2) / (pi alpha_x alpha_y cos^3(theta)).
    """
    z = w[..., 2].clamp(min=COS_FLOOR)
    slope_x, slope_y = w[..., 0] / (alpha_x * z), w[..., 1] / (alpha_y * z)
    density = torch.exp(-slope_x * slope_x - slope_y * slope_y)
    return density / (math.pi * alpha_x * alpha_y * z * z * z) * (w[..., 2] > 0.0)


def square_to_ashikhmin_shirley(u: Tensor, exponent_x: Tensor, exponent_y: Tensor) -> Tensor:
    """Half vectors `[..., 3]` of Ashikhmin and Shirley's anisotropic power cosine [AS00, §3]."""
    turn = 2.0 * math.pi * u[..., 1]
    x = torch.sqrt(exponent_y + 1.0) * torch.cos(turn)
    y = torch.sqrt(exponent_x + 1.0) * torch.sin(turn)
    x_squared, y_squared = x * x, y * y
    exponent = (exponent_x * x_squared + exponent_y * y_squared) / (x_squared + y_squared)
    return _from_depth(_depth_of_power(u[..., 0], exponent), torch.atan2(y, x))


def square_to_ashikhmin_shirley_pdf(w: Tensor, exponent_x: Tensor, exponent_y: Tensor) -> Tensor:
    """The density `[...]` of `square_to_ashikhmin_shirley` [AS00].

    It is sqrt((ex + 1)(ey + 1)) / (2 pi) cos(theta)^(ex cos^2(phi) + ey sin^2(phi)).
    """
    x_squared, y_squared = w[..., 0] ** 2, w[..., 1] ** 2
    planar = (x_squared + y_squared).clamp(min=SQUARED_RADIUS_FLOOR)
    exponent = (exponent_x * x_squared + exponent_y * y_squared) / planar
    scale = torch.sqrt((exponent_x + 1.0) * (exponent_y + 1.0)) / (2.0 * math.pi)
    return scale * torch.exp(exponent * _log_cos_theta(w)) * (w[..., 2] > 0.0)


def _depth_of_power(u: Tensor, exponent: Tensor) -> Tensor:
    """1 - cos(theta), without cancellation, of cos(theta) = (1 - u)^(1 / (exponent + 1))."""
    return -torch.expm1(torch.log1p(-u) / (exponent + 1.0))


def _from_depth(depth: Tensor, phi: Tensor) -> Tensor:
    """Unit vectors `[..., 3]` with z = 1 - `depth [...]` and azimuth phi `[...]`."""
    radius = torch.sqrt(depth * (2.0 - depth))
    depth, phi, radius = torch.broadcast_tensors(depth, phi, radius)
    return torch.stack((radius * torch.cos(phi), radius * torch.sin(phi), 1.0 - depth), dim=-1)


def _log_cos_theta(w: Tensor) -> Tensor:
    """log(cos(theta)) `[...]` of unit `w [..., 3]`, accurate near the pole."""
    z = w[..., 2].clamp(min=COS_FLOOR)
    return -0.5 * torch.log1p((w[..., 0] ** 2 + w[..., 1] ** 2) / (z * z))
