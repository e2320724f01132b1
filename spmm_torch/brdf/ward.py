"""Ward: an anisotropic Gaussian of the half vector's slope."""

from __future__ import annotations

import math

from torch import Tensor

from ..geometry.warp import square_to_beckmann, square_to_beckmann_pdf
from .base import (
    BRDF,
    NARROW_SLOPES,
    SLOPES,
    Parameter,
    above_horizon,
    exp_of_negative,
    guarded_cosines,
    half_vector,
)
from .slopes import LocalPairs, Slopes
from .visible import reflect_about_visible, unit_half_vector, visible_pdf


class Ward(BRDF):
    """The anisotropic model of Ward [War92, Eq. 5a], with the square root.

    f_r = exp(-tan^2(theta_h) (cos^2(phi_h) / ax^2 + sin^2(phi_h) / ay^2))
    / (4 pi ax ay sqrt(cos_theta_i cos_theta_o)).

    | parameter | range | meaning |
    |---|---|---|
    | alpha_x, alpha_y | 0.01 to 1 | root mean square slope along tangent and bitangent |
    """

    name, title = "ward", "Ward"
    references = (
        "G. J. Ward, Measuring and Modeling Anisotropic Reflection, Computer Graphics (SIGGRAPH) "
        "26(2), 265-272, 1992.",
        "B. Walter, Notes on the Ward BRDF, Technical Report PCG-05-06, Cornell University, 2005.",
    )
    parameters = (
        Parameter("alpha_x", 0.01, 1.0, "log", "slope along the tangent", lambda width: width),
        Parameter("alpha_y", 0.01, 1.0, "log", "slope along the bitangent", lambda width: width),
    )
    shapes = tuple((a, a) for a in SLOPES)
    peak_shapes: tuple[tuple[float, ...], ...] = tuple((a, a) for a in NARROW_SLOPES)
    anisotropic = True
    reciprocal = True
    foreshortening = 0.5  # power of 1 / cosine of each direction

    def eval(self, kappa: Tensor, wi: Tensor, wo: Tensor) -> Tensor:
        """f_r in 1/sr; see `BRDF.eval`."""
        alpha_x, alpha_y = kappa[..., 0], kappa[..., 1]
        cos_theta_i, cos_theta_o = guarded_cosines(wi, wo)
        h = half_vector(wi, wo)
        slope = (h.x_squared / alpha_x**2 + h.y_squared / alpha_y**2) / (h.z * h.z)
        scale = self._foreshortening(cos_theta_o) / (4.0 * math.pi * alpha_x * alpha_y)
        lobe = exp_of_negative(-slope) * scale * self._foreshortening(cos_theta_i)
        return lobe * above_horizon(wi, wo)

    def slopes(self, kappa: Tensor, pairs: LocalPairs) -> Slopes:
        """By hand; see `BRDF.slopes`."""
        alpha, planar, z = kappa[:, :2], pairs.half[:, :2], pairs.half[:, 2]  # x and y
        slope_xy = (planar / (alpha * alpha)).mul_(z.square().reciprocal_()[:, None])
        part = planar * slope_xy
        slope = part[:, 0] + part[:, 1]
        cos_theta_i, cos_theta_o = pairs.cosines
        ends = self._foreshortening(cos_theta_o) / (4.0 * math.pi * alpha[:, 0] * alpha[:, 1])
        value = exp_of_negative(-slope).mul_(ends).mul_(self._foreshortening(cos_theta_i))
        fall_i, fall_o = (self.foreshortening * fall for fall in pairs.falls)
        along_alpha, slope_xy = part.mul_(2.0).sub_(1.0).div_(alpha), slope_xy.mul_(-2.0)
        half = slope_xy[:, 0], slope_xy[:, 1], slope.div_(z).mul_(2.0)
        return Slopes(value, along_alpha.unbind(1), fall_i, fall_o, half)

    def sample(self, kappa: Tensor, wo: Tensor, u: Tensor) -> Tensor:
        """By visible half vectors of Gaussian slopes [Walter 2005]; see `BRDF.sample`."""
        h = square_to_beckmann(u[..., 1:], kappa[..., 0], kappa[..., 1])
        return reflect_about_visible(h, wo, u[..., 0])

    def pdf(self, kappa: Tensor, wi: Tensor, wo: Tensor) -> Tensor:
        """Density of `sample` in 1/sr; see `BRDF.pdf`."""
        h = unit_half_vector(wi, wo)
        return visible_pdf(square_to_beckmann_pdf(h, kappa[..., 0], kappa[..., 1]), h, wo)

    def _foreshortening(self, cos_theta: Tensor) -> Tensor:
        """The factor `[...]` of the cosine of one direction."""
        return cos_theta.rsqrt()


class WardDuer(Ward):
    """Ward's model without the square root [Dür 2006], which keeps more energy at grazing angles.

    | parameter | range | meaning |
    |---|---|---|
    | alpha_x, alpha_y | 0.01 to 1 | root mean square slope along tangent and bitangent |
    """

    name, title = "ward_duer", "Ward-Duer"
    references = (
        "A. Dür, An Improved Normalization for the Ward Reflectance Model, journal of graphics "
        "tools 11(1), 51-59, 2006.",
        *Ward.references,
    )
    peak_shapes = ()
    foreshortening = 1.0
    largest_weight = 6.0  # its albedo grows without bound towards grazing

    def _foreshortening(self, cos_theta: Tensor) -> Tensor:
        """The factor `[...]` of the cosine of one direction."""
        return 1.0 / cos_theta
