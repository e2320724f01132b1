"""GGX: Trowbridge-Reitz microfacets with Smith's masking and Schlick's Fresnel term."""

from __future__ import annotations

import itertools
import math

import torch
from torch import Tensor

from .base import (
    BRDF,
    INV_PI,
    NARROW_SLOPES,
    SLOPES,
    Parameter,
    above_horizon,
    guarded_cosines,
    half_vector,
    schlick_fresnel,
)
from .visible import unit_half_vector

Components = tuple[Tensor, Tensor, Tensor]  # x, y and z of vectors, each `[...]`
# Width over alpha: the slope at which the distribution falls to 1/e. It has no mean square slope.
WIDTH_OF_ALPHA = math.sqrt(math.sqrt(math.e) - 1.0)
# Keeps the direction of the shortest half vector that float32 holds.
LENGTH_FLOOR = 1e-30


def _alpha(width: float) -> float:
    """The alpha of a lobe of given width."""
    return width / WIDTH_OF_ALPHA


class GGX(BRDF):
    """f_r = F D G / (4 cos_theta_i cos_theta_o) [WMLT07], anisotropic [Hei14].

    D = 1 / (pi ax ay (hx^2 / ax^2 + hy^2 / ay^2 + hz^2)^2) [TR75]; G = 1 / (1 + L(wi) + L(wo)) is
    Smith's term with correlated heights [Hei14, Eq. 99], L(w) = (l(w) / wz - 1) / 2 and
    l(w) = sqrt(ax^2 wx^2 + ay^2 wy^2 + wz^2); F is Schlick's.

    | parameter | range | meaning |
    |---|---|---|
    | alpha_x, alpha_y | 0.01 to 1 | roughness along tangent and bitangent |
    | f0 | 0.01 to 1 | reflectance at normal incidence |
    """

    name, title = "ggx", "GGX"
    references = (
        "T. S. Trowbridge, K. P. Reitz, Average Irregularity Representation of a Rough Surface for "
        "Ray Reflection, Journal of the Optical Society of America 65(5), 531-536, 1975.",
        "B. Walter, S. R. Marschner, H. Li, K. E. Torrance, Microfacet Models for Refraction "
        "through Rough Surfaces, Eurographics Symposium on Rendering, 195-206, 2007.",
        "E. Heitz, Understanding the Masking-Shadowing Function in Microfacet-Based BRDFs, "
        "Journal of Computer Graphics Techniques 3(2), 48-107, 2014.",
        "J. Dupuy, A. Benyoub, Sampling Visible GGX Normals with Spherical Caps, Computer Graphics "
        "Forum 42(8), 2023.",
    )
    parameters = (
        Parameter("alpha_x", 0.01, 1.0, "log", "roughness along the tangent", _alpha),
        Parameter("alpha_y", 0.01, 1.0, "log", "roughness along the bitangent", _alpha),
        Parameter("f0", 0.01, 1.0, "linear", "reflectance at normal incidence"),
    )
    shapes = tuple((a, a, f0) for a, f0 in itertools.product(SLOPES, (0.04, 1.0)))
    peak_shapes = tuple((a, a, 0.3) for a in NARROW_SLOPES)
    anisotropic = True
    reciprocal = True

    def eval(self, kappa: Tensor, wi: Tensor, wo: Tensor) -> Tensor:
        """f_r in 1/sr; see `BRDF.eval`."""
        cos_theta_i, cos_theta_o = guarded_cosines(wi, wo)
        h = half_vector(wi, wo)
        alpha_x, alpha_y = kappa[..., 0], kappa[..., 1]
        # With h unnormalized, each of the two squares is divided by |wi + wo|^2.
        spread = h.x_squared / alpha_x**2 + h.y_squared / alpha_y**2 + h.z * h.z
        distribution = INV_PI / (alpha_x * alpha_y) * (h.length_squared / spread) ** 2
        # G / (4 cos_theta_i cos_theta_o) without a cosine alone in the denominator.
        length_i = _length(*_stretched(kappa, wi[..., 0], wi[..., 1], cos_theta_i))
        length_o = _length(*_stretched(kappa, wo[..., 0], wo[..., 1], cos_theta_o))
        masking = 0.5 / (cos_theta_o * length_i + cos_theta_i * length_o)
        fresnel = schlick_fresnel(kappa[..., 2], h.cos_theta_d)
        return distribution * masking * fresnel * above_horizon(wi, wo)

    def sample(self, kappa: Tensor, wo: Tensor, u: Tensor) -> Tensor:
        """By the distribution of visible normals [Dupuy and Benyoub 2023]; see `BRDF.sample`.

        Facets of alpha 1 form a hemisphere, which mirrors the view uniformly into a spherical cap;
        other alphas stretch the hemisphere.
        """
        x, y, z = wo.unbind(-1)
        view_x, view_y, view_z = _unit(*_stretched(kappa, x, y, z))
        azimuth = 2.0 * math.pi * u[..., 1]
        drop = u[..., 2] * (1.0 + view_z)  # 1 - z of a direction of the cap, exact near its pole
        radius = torch.sqrt((drop * (2.0 - drop)).clamp(min=0.0))
        h_x = view_x + radius * torch.cos(azimuth)
        h_y = view_y + radius * torch.sin(azimuth)
        h_z = (1.0 + view_z) * (1.0 - u[..., 2])
        h_x, h_y, h_z = _unit(*_stretched(kappa, h_x, h_y, h_z))
        twice = 2.0 * (h_x * x + h_y * y + h_z * z)
        return torch.stack((twice * h_x - x, twice * h_y - y, twice * h_z - z)).movedim(0, -1)

    def pdf(self, kappa: Tensor, wi: Tensor, wo: Tensor) -> Tensor:
        """Density of `sample`, D / (2 (wo_z + l(wo))), 0 if h points down; see `BRDF.pdf`."""
        alpha_x, alpha_y = kappa[..., 0], kappa[..., 1]
        x, y, z = unit_half_vector(wi, wo).unbind(-1)
        # At least 1 for unit h; there is none where wi and wo are opposite.
        spread = ((x / alpha_x) ** 2 + (y / alpha_y) ** 2 + z * z).clamp(min=1.0)
        distribution = INV_PI / (alpha_x * alpha_y * spread * spread)
        length_o = _length(*_stretched(kappa, *wo.unbind(-1)))
        return distribution * z.clamp(0.0, 1.0).ceil() / (2.0 * (wo[..., 2] + length_o))


def _stretched(kappa: Tensor, x: Tensor, y: Tensor, z: Tensor) -> Components:
    """(ax x, ay y, z): stretches vectors of a hemisphere to those of any alpha."""
    return kappa[..., 0] * x, kappa[..., 1] * y, z


def _length(x: Tensor, y: Tensor, z: Tensor) -> Tensor:
    return torch.sqrt(x * x + y * y + z * z)


def _unit(x: Tensor, y: Tensor, z: Tensor) -> Components:
    length = _length(x, y, z).clamp(min=LENGTH_FLOOR)
    return x / length, y / length, z / length
