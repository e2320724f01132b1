"""Ashikhmin-Shirley: an anisotropic Phong lobe of the half vector with Schlick's Fresnel term."""

from __future__ import annotations

import math

import torch
from torch import Tensor

from ..geometry.warp import square_to_ashikhmin_shirley, square_to_ashikhmin_shirley_pdf
from .base import (
    BRDF,
    EXPONENTS,
    NARROW_EXPONENTS,
    Parameter,
    above_horizon,
    exp_of_negative,
    guarded_cosines,
    half_vector,
    schlick_fresnel,
)
from .slopes import LocalPairs, Slopes
from .visible import reflect_about_visible, unit_half_vector, visible_pdf

# Squared sine of the half vector angle under which the azimuth does not matter.
PLANAR_EPS = 1e-12


class AshikhminShirley(BRDF):
    """The specular term of Ashikhmin and Shirley [AS00, §2].

    f_r = sqrt((nu + 1)(nv + 1)) / (8 pi) (n.h)^(nu cos^2 phi_h + nv sin^2 phi_h)
    / ((h.wi) max(n.wi, n.wo)) F(h.wi). Their diffuse term is left to other lobes.

    | parameter | range | meaning |
    |---|---|---|
    | exponent_x, exponent_y | 0.1 to 10,000 | sharpness along tangent and bitangent |
    | f0 | 0.01 to 1 | reflectance at normal incidence |
    """

    name, title = "ashikhmin_shirley", "Ashikhmin-Shirley"
    references = (
        "M. Ashikhmin, P. Shirley, An Anisotropic Phong BRDF Model, journal of graphics tools "
        "5(2), 25-32, 2000.",
    )
    parameters = (
        Parameter(
            "exponent_x", 0.1, 1e4, "log", "sharpness, tangent", lambda width: 2.0 / width**2
        ),
        Parameter(
            "exponent_y", 0.1, 1e4, "log", "sharpness, bitangent", lambda width: 2.0 / width**2
        ),
        Parameter("f0", 0.01, 1.0, "linear", "reflectance at normal incidence"),
    )
    shapes = tuple((n, n, 0.04) for n in EXPONENTS)
    peak_shapes = tuple((n, n, 0.2) for n in NARROW_EXPONENTS)
    anisotropic = True
    reciprocal = True
    largest_weight = 2.0

    def eval(self, kappa: Tensor, wi: Tensor, wo: Tensor) -> Tensor:
        """f_r in 1/sr; see `BRDF.eval`."""
        n_x, n_y, f0 = kappa[..., 0], kappa[..., 1], kappa[..., 2]
        cos_theta_i, cos_theta_o = guarded_cosines(wi, wo)
        h = half_vector(wi, wo)
        # log(n.h) / sin^2(theta_h) is finite at the pole, where the azimuth is not defined.
        log_cos_theta_h = -0.5 * torch.log1p(h.planar_squared / (h.z * h.z))
        exponent = (n_x * h.x_squared + n_y * h.y_squared) / h.planar_squared.clamp(min=PLANAR_EPS)
        lobe = exp_of_negative(exponent * log_cos_theta_h)
        cos_theta_d = h.cos_theta_d
        scale = torch.sqrt((n_x + 1.0) * (n_y + 1.0)) / (8.0 * math.pi)
        facing = cos_theta_d * torch.maximum(cos_theta_i, cos_theta_o)
        value = scale * lobe * schlick_fresnel(f0, cos_theta_d) / facing
        return value * above_horizon(wi, wo)

    def slopes(self, kappa: Tensor, pairs: LocalPairs) -> Slopes:
        """By hand; see `BRDF.slopes`."""
        n, f0, planar = kappa[:, :2], kappa[:, 2], pairs.half[:, :2]  # n, planar: x and y
        (cos_theta_i, cos_theta_o), (fall_i, fall_o) = pairs.cosines, pairs.falls
        log_cos_theta_h, share = pairs.log_cos_theta_h, planar.square()
        inverse = (share[:, 0] + share[:, 1]).clamp_(min=PLANAR_EPS).reciprocal_()
        share.mul_(inverse[:, None])
        exponent = (n[:, 0] * share[:, 0]).addcmul_(n[:, 1], share[:, 1])
        fresnel, above = pairs.angles.fresnel(f0), n + 1.0
        scale = torch.sqrt(above[:, 0] * above[:, 1]) / (8.0 * math.pi)
        facing = torch.maximum(cos_theta_i, cos_theta_o).mul_(pairs.angles.cos_theta_d)
        value = exp_of_negative(exponent * log_cos_theta_h).mul_(fresnel).div_(facing)
        turn = inverse.mul_(log_cos_theta_h).mul_(2.0)
        along_n = share.mul_(log_cos_theta_h[:, None]).add_(0.5 / above)
        along_planar = (turn[:, None] * planar).mul_(n - exponent[:, None])
        return Slopes(
            value.mul_(scale),
            (*along_n.unbind(1), pairs.angles.direct / fresnel),
            pairs.of_wi * fall_i,
            (1.0 - pairs.of_wi) * fall_o,
            (along_planar[:, 0], along_planar[:, 1], exponent / pairs.half[:, 2]),
        )

    def sample(self, kappa: Tensor, wo: Tensor, u: Tensor) -> Tensor:
        """By visible half vectors of the anisotropic power [AS00, §3]; see `BRDF.sample`."""
        h = square_to_ashikhmin_shirley(u[..., 1:], kappa[..., 0], kappa[..., 1])
        return reflect_about_visible(h, wo, u[..., 0])

    def pdf(self, kappa: Tensor, wi: Tensor, wo: Tensor) -> Tensor:
        """Density of `sample` in 1/sr; see `BRDF.pdf`."""
        h = unit_half_vector(wi, wo)
        return visible_pdf(square_to_ashikhmin_shirley_pdf(h, kappa[..., 0], kappa[..., 1]), h, wo)
