"""Closures of Open Shading Language as Blender Cycles evaluates them.

Each is a function of local directions like a BRDF, with the cosine of the light. Sources: [AS00],
[WMLT07], [Hei14] as for the BRDFs of the registry; the masking of Beckmann's distribution is the
rational fit of [WMLT07]; Oren-Nayar in the form of Y. Fujii, A tiny improvement of Oren-Nayar
reflectance model, note, 2013.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import torch
from torch import Tensor

from ..brdf.base import COS_EPS, INV_PI, schlick_fresnel
from ..brdf.visible import unit_half_vector

# Columns of the parameters of a closure.
ALPHA_X, ALPHA_Y, F0, SIGMA = range(4)
# Roughness that Cycles clamps to.
LEAST_ALPHA, MOST_ALPHA = 1e-4, 1.0
# Where the rational fit of the masking of Beckmann's distribution ends.
BECKMANN_END = 1.6

Closure = Callable[[Tensor, Tensor, Tensor], Tensor]


def diffuse(parameters: Tensor, wi: Tensor, wo: Tensor) -> Tensor:
    """Lambertian; see `value`, `[...]`."""
    return INV_PI * wi[..., 2] * torch.ones_like(parameters[..., 0])


def oren_nayar(parameters: Tensor, wi: Tensor, wo: Tensor) -> Tensor:
    """Fujii's form of Oren-Nayar; see `value`, `[...]`."""
    sigma = parameters[..., SIGMA].clamp(0.0, 1.0)
    a = 1.0 / (math.pi + (3.0 * math.pi - 4.0) / 6.0 * sigma)
    swing = wi[..., 0] * wo[..., 0] + wi[..., 1] * wo[..., 1]
    larger = torch.maximum(wi[..., 2], wo[..., 2]).clamp(min=COS_EPS)
    swing = torch.where(swing > 0.0, swing / larger, swing)
    return (a * wi[..., 2] * (1.0 + sigma * swing)).clamp(min=0.0)


def beckmann(parameters: Tensor, wi: Tensor, wo: Tensor) -> Tensor:
    """Microfacets of Beckmann's distribution without Fresnel term; see `value`, `[...]`."""
    alpha_x, alpha_y = _alphas(parameters)
    h = unit_half_vector(wi, wo)
    z = h[..., 2].clamp(min=COS_EPS)
    slope = ((h[..., 0] / alpha_x) ** 2 + (h[..., 1] / alpha_y) ** 2) / (z * z)
    density = INV_PI * torch.exp(-slope) / (alpha_x * alpha_y * z**4)
    masking = 1.0 + _beckmann_lambda(parameters, wi) + _beckmann_lambda(parameters, wo)
    return density / (4.0 * wo[..., 2].clamp(min=COS_EPS) * masking)


def ggx(parameters: Tensor, wi: Tensor, wo: Tensor) -> Tensor:
    """Microfacets of the GGX distribution without Fresnel term; see `value`, `[...]`."""
    alpha_x, alpha_y = _alphas(parameters)
    h = unit_half_vector(wi, wo)
    spread = (h[..., 0] / alpha_x) ** 2 + (h[..., 1] / alpha_y) ** 2 + h[..., 2] ** 2
    density = INV_PI / (alpha_x * alpha_y * spread.clamp(min=1e-12) ** 2)
    masking = [0.5 * (torch.sqrt(1.0 + _slope_squared(parameters, w)) - 1.0) for w in (wi, wo)]
    return density / (4.0 * wo[..., 2].clamp(min=COS_EPS) * (1.0 + masking[0] + masking[1]))


def ashikhmin_shirley(parameters: Tensor, wi: Tensor, wo: Tensor) -> Tensor:
    """Ashikhmin-Shirley without Fresnel term; see `value`, `[...]`."""
    n_x, n_y = (2.0 / (alpha * alpha) - 2.0 for alpha in _alphas(parameters))
    h = unit_half_vector(wi, wo)
    planar = (h[..., 0] ** 2 + h[..., 1] ** 2).clamp(min=1e-12)
    exponent = (n_x * h[..., 0] ** 2 + n_y * h[..., 1] ** 2) / planar
    lobe = torch.exp(exponent * torch.log(h[..., 2].clamp(COS_EPS, 1.0)))
    scale = torch.sqrt((n_x + 1.0) * (n_y + 1.0)) / (8.0 * math.pi)
    facing = (h * wo).sum(-1) * torch.maximum(wi[..., 2], wo[..., 2])
    return scale * lobe * wi[..., 2] / facing.clamp(min=1e-6)


def _with_schlick(plain: Closure) -> Closure:
    """A closure with Schlick's Fresnel term of F0 and F90 = 1."""

    def schlick(parameters: Tensor, wi: Tensor, wo: Tensor) -> Tensor:
        cosine = (unit_half_vector(wi, wo) * wo).sum(-1)
        return plain(parameters, wi, wo) * schlick_fresnel(parameters[..., F0], cosine)

    return schlick


# By their names in the shader; the place is the number in its files.
CLOSURES: dict[str, Closure] = {
    "DIFFUSE": diffuse,
    "OREN_NAYAR": oren_nayar,
    "BECKMANN": beckmann,
    "GGX": ggx,
    "ASHIKHMIN_SHIRLEY": ashikhmin_shirley,
    "SCHLICK_BECKMANN": _with_schlick(beckmann),
    "SCHLICK_GGX": _with_schlick(ggx),
}
KINDS = tuple(CLOSURES)


def value(kind: Tensor, parameters: Tensor, wi: Tensor, wo: Tensor) -> Tensor:
    """Closures times the cosine of the light, in 1/sr, `[N]`; 0 under the horizon.

    Args:
        kind: places in `KINDS`, `[N]`.
        parameters: roughness along tangent and bitangent, F0, sigma, `[N, 4]`.
        wi, wo: directions in the frame of each closure, `[N, 3]`.
    """
    result = wi.new_zeros(len(kind))
    lit = (wi[:, 2] > 0.0) & (wo[:, 2] > 0.0)
    for number, closure in enumerate(CLOSURES.values()):
        rows = torch.nonzero(lit & (kind == number)).squeeze(1)
        if len(rows):
            result[rows] = closure(*(part[rows] for part in (parameters, wi, wo)))
    return result


def _alphas(parameters: Tensor) -> tuple[Tensor, Tensor]:
    clamped = parameters[..., :2].clamp(LEAST_ALPHA, MOST_ALPHA)
    return clamped[..., 0], clamped[..., 1]


def _slope_squared(parameters: Tensor, w: Tensor) -> Tensor:
    """Squared tangent of directions, stretched by the roughness, `[...]`."""
    alpha_x, alpha_y = _alphas(parameters)
    planar = (alpha_x * w[..., 0]) ** 2 + (alpha_y * w[..., 1]) ** 2
    return planar / w[..., 2].clamp(min=COS_EPS) ** 2


def _beckmann_lambda(parameters: Tensor, w: Tensor) -> Tensor:
    a = _slope_squared(parameters, w).clamp(min=1e-12).rsqrt()
    fit = (1.0 - 1.259 * a + 0.396 * a * a) / (3.535 * a + 2.181 * a * a)
    return torch.where(a < BECKMANN_END, fit, 0.0 * a)
