"""Cook-Torrance: Beckmann microfacets in V-grooves with Schlick's Fresnel term."""

from __future__ import annotations

import itertools

import torch
from torch import Tensor

from ..geometry.warp import square_to_beckmann, square_to_beckmann_pdf
from .base import (
    BRDF,
    INV_PI,
    NARROW_SLOPES,
    SLOPES,
    Parameter,
    above_horizon,
    exp_of_negative,
    guarded_cosines,
    half_vector,
    schlick_fresnel,
)
from .slopes import LocalPairs, Slopes, is_above
from .visible import reflect_about_visible, unit_half_vector, visible_pdf


class CookTorrance(BRDF):
    """f_r = F D G / (4 cos_theta_i cos_theta_o) [CT82], as compared by [NDM05, §2].

    D is Beckmann's distribution with root mean square slope alpha, normalized over projected
    area (hence 4 where the original has pi); G = min(1, 2 (n.h)(n.wo) / (wo.h),
    2 (n.h)(n.wi) / (wo.h)) is the V-groove term; F is Schlick's.

    | parameter | range | meaning |
    |---|---|---|
    | alpha | 0.01 to 1 | root mean square slope of the microfacets |
    | f0 | 0.01 to 1 | reflectance at normal incidence |
    """

    name, title = "cook_torrance", "Cook-Torrance"
    references = (
        "R. L. Cook, K. E. Torrance, A Reflectance Model for Computer Graphics, ACM Transactions "
        "on Graphics 1(1), 7-24, 1982.",
        "A. Ngan, F. Durand, W. Matusik, Experimental Analysis of BRDF Models, Eurographics "
        "Symposium on Rendering, 117-126, 2005.",
    )
    parameters = (
        Parameter("alpha", 0.01, 1.0, "log", "slope of the microfacets", lambda width: width),
        Parameter("f0", 0.01, 1.0, "linear", "reflectance at normal incidence"),
    )
    shapes = tuple(itertools.product(SLOPES, (0.04, 1.0)))
    peak_shapes = tuple((a, 0.3) for a in NARROW_SLOPES)
    anisotropic = False
    reciprocal = True

    def eval(self, kappa: Tensor, wi: Tensor, wo: Tensor) -> Tensor:
        """f_r in 1/sr; see `BRDF.eval`."""
        alpha_squared = kappa[..., 0] ** 2
        cos_theta_i, cos_theta_o = guarded_cosines(wi, wo)
        h = half_vector(wi, wo)
        z_squared = h.z * h.z
        tan_squared = h.planar_squared / z_squared
        sec_squared = h.length_squared / z_squared
        beckmann = exp_of_negative(-tan_squared / alpha_squared) * sec_squared * sec_squared
        # With h unnormalized, 2 (n.h)(n.w) / (w.h) is 4 z (n.w) / |wi + wo|^2.
        groove = 4.0 * h.z / h.length_squared * torch.minimum(cos_theta_i, cos_theta_o)
        fresnel = schlick_fresnel(kappa[..., 1], h.cos_theta_d)
        scale = 0.25 * INV_PI / (alpha_squared * cos_theta_i)
        value = scale / cos_theta_o * beckmann * fresnel * groove.clamp(max=1.0)
        return value * above_horizon(wi, wo)

    def slopes(self, kappa: Tensor, pairs: LocalPairs) -> Slopes:
        """By hand; see `BRDF.slopes`."""
        (alpha, f0), z = kappa.unbind(1), pairs.half[:, 2]
        (cos_theta_i, cos_theta_o), (fall_i, fall_o) = pairs.cosines, pairs.falls
        inverse, of_alpha = z.reciprocal(), (alpha * alpha).reciprocal()
        squared = inverse * inverse
        spread = (pairs.planar_squared * squared).mul_(of_alpha)  # tan^2 / alpha^2
        sec_squared = squared.mul_(pairs.angles.length_squared)
        fresnel = pairs.angles.fresnel(f0)
        groove = z * torch.minimum(cos_theta_i, cos_theta_o)
        groove.mul_(pairs.angles.groove)
        shadowed = (1.0 - groove).gt_(0.0)
        value = exp_of_negative(-spread).mul_(sec_squared).mul_(sec_squared).mul_(fresnel)
        value.mul_(groove.clamp_(max=1.0)).mul_(0.25 * INV_PI * of_alpha / cos_theta_i)
        by_i = is_above(cos_theta_o, cos_theta_i).mul_(shadowed)
        along_z = (2.0 * of_alpha * sec_squared).sub_(4.0).add_(shadowed).mul_(inverse)
        return Slopes(
            value.div_(cos_theta_o),
            ((spread - 1.0).mul_(2.0 / alpha), pairs.angles.direct / fresnel),
            (1.0 - by_i) * fall_i,
            (1.0 - shadowed).add_(by_i).mul_(fall_o),
            (None, None, along_z),
        )

    def sample(self, kappa: Tensor, wo: Tensor, u: Tensor) -> Tensor:
        """By the distribution of visible normals [Heitz and d'Eon 2014]; see `BRDF.sample`."""
        h = square_to_beckmann(u[..., 1:], kappa[..., 0], kappa[..., 0])
        return reflect_about_visible(h, wo, u[..., 0])

    def pdf(self, kappa: Tensor, wi: Tensor, wo: Tensor) -> Tensor:
        """Density of `sample` in 1/sr; see `BRDF.pdf`."""
        h = unit_half_vector(wi, wo)
        return visible_pdf(square_to_beckmann_pdf(h, kappa[..., 0], kappa[..., 0]), h, wo)
