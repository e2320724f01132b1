"""Ward: an anisotropic Gaussian of the half vector's slope."""

from __future__ import annotations

import math

from torch import Tensor

from ..geometry.warp import square_to_beckmann, square_to_beckmann_pdf
from .base import Parameter, above_horizon, exp_of_negative, guarded_cosines, half_vector
from .visible import reflect_about_visible, unit_half_vector, visible_pdf


class Ward:
    """The anisotropic model of Ward [War92, Eq. 5a], with the square root.

    f_r = exp(-tan^2(theta_h) (cos^2(phi_h) / ax^2 + sin^2(phi_h) / ay^2))
    / (4 pi ax ay sqrt(cos_theta_i cos_theta_o)).

    `Ward("ward_duer", duer=True)` drops the square root [Dür 2006], which keeps more energy at
    grazing angles.

    | parameter | range | meaning |
    |---|---|---|
    | alpha_x, alpha_y | 0.01 to 1 | root mean square slope along tangent and bitangent |
    """

    parameters = (
        Parameter("alpha_x", 0.01, 1.0, "log", "slope along the tangent", lambda width: width),
        Parameter("alpha_y", 0.01, 1.0, "log", "slope along the bitangent", lambda width: width),
    )
    anisotropic = True
    reciprocal = True

    def __init__(self, name: str = "ward", duer: bool = False) -> None:
        self.name = name
        self.duer = duer

    def eval(self, kappa: Tensor, wi: Tensor, wo: Tensor) -> Tensor:
        """f_r in 1/sr; see `BRDF.eval`."""
        alpha_x, alpha_y = kappa[..., 0], kappa[..., 1]
        cos_theta_i, cos_theta_o = guarded_cosines(wi, wo)
        h = half_vector(wi, wo)
        slope = (h.x_squared / alpha_x**2 + h.y_squared / alpha_y**2) / (h.z * h.z)
        if self.duer:
            foreshortening_i, foreshortening_o = 1.0 / cos_theta_i, 1.0 / cos_theta_o
        else:
            foreshortening_i, foreshortening_o = cos_theta_i.rsqrt(), cos_theta_o.rsqrt()
        scale = foreshortening_o / (4.0 * math.pi * alpha_x * alpha_y)
        return exp_of_negative(-slope) * scale * foreshortening_i * above_horizon(wi, wo)

    def sample(self, kappa: Tensor, wo: Tensor, u: Tensor) -> Tensor:
        """By visible half vectors of Gaussian slopes [Walter 2005]; see `BRDF.sample`."""
        h = square_to_beckmann(u[..., 1:], kappa[..., 0], kappa[..., 1])
        return reflect_about_visible(h, wo, u[..., 0])

    def pdf(self, kappa: Tensor, wi: Tensor, wo: Tensor) -> Tensor:
        """Density of `sample` in 1/sr; see `BRDF.pdf`."""
        h = unit_half_vector(wi, wo)
        return visible_pdf(square_to_beckmann_pdf(h, kappa[..., 0], kappa[..., 1]), h, wo)
