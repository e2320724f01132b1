"""Blinn-Phong: a cosine power of the half vector."""

from __future__ import annotations

import math

import torch
from torch import Tensor

from ..geometry.warp import square_to_power_cosine, square_to_power_cosine_pdf
from .base import (
    BRDF,
    EXPONENTS,
    NARROW_EXPONENTS,
    Parameter,
    above_horizon,
    exp_of_negative,
    half_vector,
)
from .slopes import LocalPairs, Slopes
from .visible import reflect_about_visible, unit_half_vector, visible_pdf


class BlinnPhong(BRDF):
    """f_r = c(n) (n . h)^n [Blinn 1977], as compared by [NDM05, §2].

    c(n) = (n + 2)(n + 4) / (8 pi (2^(-n/2) + n)) makes the albedo 1 at normal incidence, where
    it is largest (F. Giesen, 2009, derives it).

    | parameter | range | meaning |
    |---|---|---|
    | exponent | 0.1 to 10,000 | sharpness; about 2 / alpha^2 of a microfacet model |
    """

    name, title = "blinn_phong", "Blinn-Phong"
    references = (
        "J. F. Blinn, Models of Light Reflection for Computer Synthesized Pictures, Computer "
        "Graphics (SIGGRAPH) 11(2), 192-198, 1977.",
        "A. Ngan, F. Durand, W. Matusik, Experimental Analysis of BRDF Models, Eurographics "
        "Symposium on Rendering, 117-126, 2005.",
        "F. Giesen, Derivation of Phong and Blinn-Phong BRDF Normalization Factors, note, 2009.",
    )
    parameters = (
        Parameter(
            "exponent", 0.1, 1e4, "log", "sharpness of the lobe", lambda width: 2.0 / width**2
        ),
    )
    shapes = tuple((n,) for n in EXPONENTS)
    peak_shapes = tuple((n,) for n in NARROW_EXPONENTS)
    anisotropic = False
    reciprocal = True
    largest_weight = 4.0

    def eval(self, kappa: Tensor, wi: Tensor, wo: Tensor) -> Tensor:
        """f_r in 1/sr; see `BRDF.eval`."""
        n = kappa[..., 0]
        h = half_vector(wi, wo)
        log_cos_theta_h = -0.5 * torch.log1p(h.planar_squared / (h.z * h.z))
        scale = (n + 2.0) * (n + 4.0) / (8.0 * math.pi * (torch.exp2(-0.5 * n) + n))
        return scale * exp_of_negative(n * log_cos_theta_h) * above_horizon(wi, wo)

    def slopes(self, kappa: Tensor, pairs: LocalPairs) -> Slopes:
        """By hand; see `BRDF.slopes`."""
        (n,), log_cos_theta_h = kappa.unbind(1), pairs.log_cos_theta_h
        fall = torch.exp2(-0.5 * n)
        two, four, below = n + 2.0, n + 4.0, fall + n
        scale = two * four / (8.0 * math.pi * below)
        growth = two.reciprocal() + four.reciprocal()
        growth = growth - (1.0 - 0.5 * math.log(2.0) * fall) / below
        return Slopes(
            exp_of_negative(n * log_cos_theta_h).mul_(scale),
            (growth + log_cos_theta_h,),
            half=(None, None, n / pairs.half[:, 2]),
        )

    def sample(self, kappa: Tensor, wo: Tensor, u: Tensor) -> Tensor:
        """By visible half vectors spread as (n . h)^(n + 1); see `BRDF.sample`."""
        h = square_to_power_cosine(u[..., 1:], kappa[..., 0] + 1.0)
        return reflect_about_visible(h, wo, u[..., 0])

    def pdf(self, kappa: Tensor, wi: Tensor, wo: Tensor) -> Tensor:
        """Density of `sample` in 1/sr; see `BRDF.pdf`."""
        h = unit_half_vector(wi, wo)
        return visible_pdf(square_to_power_cosine_pdf(h, kappa[..., 0] + 1.0), h, wo)
