"""Warps of the unit square to directions, each with the density of what it makes.

`square_to_x(u, ...)` takes points `u [..., 2]` of [0, 1)^2 to unit vectors `[..., 3]` about +z, and
`square_to_x_pdf(w, ...)` is its density at unit vectors `w [..., 3]`, per solid angle (1/sr). All
densities are over the whole sphere and 0 under the horizon. Parameters `[...]` broadcast.
"""

from __future__ import annotations

import math

import torch
from torch import Tensor

# Cosines under it count as this one where they are divided by; its cube is a normal float32.
COS_FLOOR = 1e-6


def square_to_cosine_hemisphere(u: Tensor) -> Tensor:
    """Directions spread as their cosine: Malley's method."""
    radius, z = torch.sqrt(u[..., 0]), torch.sqrt(1.0 - u[..., 0])
    phi = 2.0 * math.pi * u[..., 1]
    return torch.stack((radius * torch.cos(phi), radius * torch.sin(phi), z), dim=-1)


def square_to_cosine_hemisphere_pdf(w: Tensor) -> Tensor:
    """cos(theta) / pi."""
    return w[..., 2].clamp(min=0.0) / math.pi


def square_to_uniform_hemisphere(u: Tensor) -> Tensor:
    """Directions spread evenly by solid angle."""
    return _from_depth(u[..., 0], 2.0 * math.pi * u[..., 1])


def square_to_uniform_hemisphere_pdf(w: Tensor) -> Tensor:
    """1 / (2 pi)."""
    return (w[..., 2] >= 0.0).to(w.dtype) / (2.0 * math.pi)


def square_to_power_cosine(u: Tensor, exponent: Tensor) -> Tensor:
    """Directions spread as cos^exponent(theta), exponent > -1."""
    return _from_depth(_depth_of_power(u[..., 0], exponent), 2.0 * math.pi * u[..., 1])


def square_to_power_cosine_pdf(w: Tensor, exponent: Tensor) -> Tensor:
    """(exponent + 1) / (2 pi) cos^exponent(theta)."""
    density = (exponent + 1.0) / (2.0 * math.pi) * torch.exp(exponent * _log_cos_theta(w))
    return density * (w[..., 2] > 0.0)


def square_to_beckmann(u: Tensor, alpha_x: Tensor, alpha_y: Tensor) -> Tensor:
    """Microfacet normals whose slopes are Gaussian, of root mean square alpha_x and alpha_y.

    [Walter 2005] gives the same for Ward's half vectors, [Walter et al. 2007, Eq. 28, 29] for
    alpha_x = alpha_y.
    """
    radius = torch.sqrt(-torch.log1p(-u[..., 0]))
    phi = 2.0 * math.pi * u[..., 1]
    slope_x, slope_y = alpha_x * radius * torch.cos(phi), alpha_y * radius * torch.sin(phi)
    z = torch.rsqrt(1.0 + slope_x * slope_x + slope_y * slope_y)
    return torch.stack((slope_x * z, slope_y * z, z), dim=-1)


def square_to_beckmann_pdf(w: Tensor, alpha_x: Tensor, alpha_y: Tensor) -> Tensor:
    """exp(-(slope_x / alpha_x)^2 - (slope_y / alpha_y)^2) / (pi alpha_x alpha_y cos^3(theta))."""
    z = w[..., 2].clamp(min=COS_FLOOR)
    slope_x, slope_y = w[..., 0] / (alpha_x * z), w[..., 1] / (alpha_y * z)
    density = torch.exp(-slope_x * slope_x - slope_y * slope_y)
    return density / (math.pi * alpha_x * alpha_y * z * z * z) * (w[..., 2] > 0.0)


def square_to_ashikhmin_shirley(u: Tensor, exponent_x: Tensor, exponent_y: Tensor) -> Tensor:
    """Half vectors of Ashikhmin and Shirley's anisotropic power [AS00, §3]."""
    turn = 2.0 * math.pi * u[..., 1]
    x = torch.sqrt(exponent_y + 1.0) * torch.cos(turn)
    y = torch.sqrt(exponent_x + 1.0) * torch.sin(turn)
    x_squared, y_squared = x * x, y * y
    exponent = (exponent_x * x_squared + exponent_y * y_squared) / (x_squared + y_squared)
    return _from_depth(_depth_of_power(u[..., 0], exponent), torch.atan2(y, x))


def square_to_ashikhmin_shirley_pdf(w: Tensor, exponent_x: Tensor, exponent_y: Tensor) -> Tensor:
    """sqrt((ex + 1)(ey + 1)) / (2 pi) cos(theta)^(ex cos^2(phi) + ey sin^2(phi)) [AS00]."""
    x_squared, y_squared = w[..., 0] ** 2, w[..., 1] ** 2
    planar = (x_squared + y_squared).clamp(min=COS_FLOOR * COS_FLOOR)
    exponent = (exponent_x * x_squared + exponent_y * y_squared) / planar
    scale = torch.sqrt((exponent_x + 1.0) * (exponent_y + 1.0)) / (2.0 * math.pi)
    return scale * torch.exp(exponent * _log_cos_theta(w)) * (w[..., 2] > 0.0)


def _depth_of_power(u: Tensor, exponent: Tensor) -> Tensor:
    """1 - cos(theta), in all its digits, of cos(theta) = (1 - u)^(1 / (exponent + 1))."""
    return -torch.expm1(torch.log1p(-u) / (exponent + 1.0))


def _from_depth(depth: Tensor, phi: Tensor) -> Tensor:
    """Unit vectors `[..., 3]` that lie `depth [...]` under the top of the sphere, at phi."""
    radius = torch.sqrt(depth * (2.0 - depth))
    depth, phi, radius = torch.broadcast_tensors(depth, phi, radius)
    return torch.stack((radius * torch.cos(phi), radius * torch.sin(phi), 1.0 - depth), dim=-1)


def _log_cos_theta(w: Tensor) -> Tensor:
    """log(cos(theta)) of unit `w [..., 3]`, exact for narrow lobes."""
    z = w[..., 2].clamp(min=COS_FLOOR)
    return -0.5 * torch.log1p((w[..., 0] ** 2 + w[..., 1] ** 2) / (z * z))
