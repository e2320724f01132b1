"""Oren-Nayar: rough diffuse surfaces made of Lambertian V-grooves."""

from __future__ import annotations

import math

import torch
from torch import Tensor

from ..geometry.warp import square_to_cosine_hemisphere, square_to_cosine_hemisphere_pdf
from .base import BRDF, INV_PI, Parameter, above_horizon, guarded_cosines
from .slopes import LocalPairs, Slopes


class OrenNayar(BRDF):
    """The qualitative model of Oren and Nayar [ON94, Eq. 30], without inter-reflection.

    f_r = (A + B max(0, cos(phi_i - phi_o)) sin(alpha) tan(beta)) / pi, with
    A = 1 - 0.5 s^2 / (s^2 + 0.33), B = 0.45 s^2 / (s^2 + 0.09) and s the roughness.

    | parameter | range | meaning |
    |---|---|---|
    | sigma | 0 to pi/2 rad | standard deviation of the groove angle; 0 is Lambertian |
    """

    name, title = "oren_nayar", "Oren-Nayar"
    references = (
        "M. Oren, S. K. Nayar, Generalization of Lambert's Reflectance Model, SIGGRAPH 94 "
        "Conference Proceedings, 239-246, 1994.",
    )
    parameters = (
        Parameter("sigma", 0.0, math.pi / 2.0, "linear", "standard deviation of slope angle, rad"),
    )
    shapes = ((0.9,),)
    anisotropic = False
    reciprocal = True
    largest_weight = 5.0  # the cosine does not follow the rise towards grazing

    def eval(self, kappa: Tensor, wi: Tensor, wo: Tensor) -> Tensor:
        """f_r in 1/sr; see `BRDF.eval`."""
        sigma_squared = kappa[..., 0] ** 2
        a = 1.0 - 0.5 * sigma_squared / (sigma_squared + 0.33)
        b = 0.45 * sigma_squared / (sigma_squared + 0.09)
        cos_theta_i, cos_theta_o = guarded_cosines(wi, wo)
        # cos(phi_i - phi_o) sin(alpha) tan(beta) is the product of the projections on the
        # surface over the larger of both cosines.
        planar = wi[..., 0] * wo[..., 0] + wi[..., 1] * wo[..., 1]
        swing = planar.clamp(min=0.0) / torch.maximum(cos_theta_i, cos_theta_o)
        return INV_PI * (a + b * swing) * above_horizon(wi, wo)

    def slopes(self, kappa: Tensor, pairs: LocalPairs) -> Slopes:
        """By hand; see `BRDF.slopes`."""
        (sigma,), (cos_theta_i, cos_theta_o) = kappa.unbind(1), pairs.cosines
        sigma_squared = sigma * sigma
        near, far = (sigma_squared + 0.33).reciprocal(), (sigma_squared + 0.09).reciprocal()
        a, b = 1.0 - 0.5 * sigma_squared * near, 0.45 * sigma_squared * far
        larger = torch.maximum(cos_theta_i, cos_theta_o)
        z_i, z_o = pairs.wi[:, 2], pairs.wo[:, 2]
        planar = pairs.planar_cosine.clamp(min=0.0)
        inside = planar.sign()
        swing = planar.div_(larger)
        value = torch.addcmul(a, b, swing)
        share = (b / (value * larger)).neg_()
        of_i = pairs.of_wi * swing
        rise = sigma * (0.09 * 0.9 * far * far * swing - 0.33 * near * near)
        return Slopes(
            value * INV_PI,
            (rise / value,),
            share * torch.addcmul(of_i, inside, z_o),
            share * torch.addcmul(swing - of_i, inside, z_i),
        )

    def sample(self, kappa: Tensor, wo: Tensor, u: Tensor) -> Tensor:
        """By the cosine; see `BRDF.sample`."""
        return square_to_cosine_hemisphere(u[..., 1:])

    def pdf(self, kappa: Tensor, wi: Tensor, wo: Tensor) -> Tensor:
        """Density of `sample` in 1/sr; see `BRDF.pdf`."""
        return square_to_cosine_hemisphere_pdf(wi)
