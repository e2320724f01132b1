"""Lafortune: the generalized cosine lobe."""

from __future__ import annotations

import itertools
import math

import torch
from torch import Tensor
from torch.nn.functional import normalize

from ..geometry.directions import frame_from_normal
from ..geometry.warp import square_to_power_cosine, square_to_power_cosine_pdf
from .base import BRDF, Parameter, above_horizon, exp_of_negative
from .slopes import LocalPairs, Slopes, is_above

# Least base of the power, which is computed by the logarithm of the base.
BASE_EPS = 1e-6


class Lafortune(BRDF):
    """f_r = (n + 2) / (2 pi) max(0, (C (wi.x wo.x + wi.y wo.y) + wi.z wo.z) / m)^n [LFTG97].

    The isotropic generalized cosine lobe with C = Cx / Cz: the common scale of Cx and Cz belongs
    to the weight. m = max(1, |C|) keeps the base at 1 or below, and so the albedo too. C = -1 is
    Phong's mirror lobe, between -1 and 0 it leans to the normal, beyond -1 it peaks off the
    mirror direction towards grazing, and positive C sends light back.

    | parameter | range | meaning |
    |---|---|---|
    | c_xy | -2 to 2 | Cx / Cz, direction of the lobe |
    | exponent | 0.1 to 2,500 | sharpness |
    """

    name, title = "lafortune", "Lafortune"
    references = (
        "E. P. F. Lafortune, S.-C. Foo, K. E. Torrance, D. P. Greenberg, Non-Linear Approximation "
        "of Reflectance Functions, SIGGRAPH 97 Conference Proceedings, 117-126, 1997.",
    )
    parameters = (
        Parameter("c_xy", -2.0, 2.0, "linear", "Cx / Cz, direction of the lobe"),
        # The lobe is a cosine power of wi itself, which turns twice as far as the half vector.
        Parameter(
            "exponent", 0.1, 2500.0, "log", "sharpness of the lobe", lambda width: 0.5 / width**2
        ),
    )
    shapes = tuple(itertools.product((-1.4, -1.0, -0.5, 1.0), (3.0, 12.0, 50.0)))
    anisotropic = False
    reciprocal = True
    largest_weight = 2.0

    def eval(self, kappa: Tensor, wi: Tensor, wo: Tensor) -> Tensor:
        """f_r in 1/sr; see `BRDF.eval`."""
        c_xy, n = kappa[..., 0], kappa[..., 1]
        planar = wi[..., 0] * wo[..., 0] + wi[..., 1] * wo[..., 1]
        base = (c_xy * planar + wi[..., 2] * wo[..., 2]) / c_xy.abs().clamp(min=1.0)
        lobe = exp_of_negative(n * torch.log(base.clamp(min=BASE_EPS)))
        lit = above_horizon(wi, wo) * (base - BASE_EPS).detach().sign().clamp(min=0.0)
        return (n + 2.0) / (2.0 * math.pi) * lobe * lit

    def slopes(self, kappa: Tensor, pairs: LocalPairs) -> Slopes:
        """By hand; see `BRDF.slopes`."""
        c_xy, n = kappa.unbind(1)
        z_i, z_o, size = pairs.wi[:, 2], pairs.wo[:, 2], c_xy.abs()
        scale = size.clamp(min=1.0).reciprocal_()
        upright, more = (1.0 - c_xy) * scale, n + 2.0
        upright_i = upright * z_i
        base = torch.addcmul(c_xy * scale * pairs.angles.cosine, upright_i, z_o)
        lit = is_above(base, BASE_EPS)
        base.clamp_(min=BASE_EPS)
        log_base = torch.log(base)
        value = exp_of_negative(n * log_base).mul_(lit).mul_(more / (2.0 * math.pi))
        rise = n / base
        beyond = (size > 1.0) * c_xy.sign() * n * scale  # d log of the divisor
        return Slopes(
            value,
            ((pairs.planar_cosine * scale).mul_(rise).sub_(beyond), more.reciprocal() + log_base),
            rise * (upright * z_o),
            rise * upright_i,
        )

    def sample(self, kappa: Tensor, wo: Tensor, u: Tensor) -> Tensor:
        """By the cosine power about the lobe's axis; see `BRDF.sample`."""
        about_z = square_to_power_cosine(u[..., 1:], kappa[..., 1])
        return (about_z[..., None, :] @ _about_axis(kappa[..., 0], wo))[..., 0, :]

    def pdf(self, kappa: Tensor, wi: Tensor, wo: Tensor) -> Tensor:
        """Density of `sample` in 1/sr; see `BRDF.pdf`."""
        about_z = (_about_axis(kappa[..., 0], wo) @ wi[..., None])[..., 0]
        return square_to_power_cosine_pdf(about_z, kappa[..., 1])


def _about_axis(c_xy: Tensor, wo: Tensor) -> Tensor:
    """Rotations `[..., 3, 3]` that take the axis of the lobe, (C wo.x, C wo.y, wo.z), to z."""
    x, y = c_xy * wo[..., 0], c_xy * wo[..., 1]
    axis = torch.stack((x, y, wo[..., 2].expand(x.shape)), dim=-1)
    return frame_from_normal(normalize(axis, dim=-1), torch.zeros_like(x))
