"""Ashikhmin-Shirley in Dr.Jit."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from ...brdf.ashikhmin_shirley import PLANAR_EPS
from ..libraries import dr
from .base import (
    Kappa,
    Twin,
    exp_of_negative,
    guarded_cosines,
    half_vector,
    log_cos_theta,
    schlick_fresnel,
)
from .visible import reflect_about_visible, unit_half_vector, visible_pdf
from .warp import ashikhmin_shirley_pdf, square_to_ashikhmin_shirley


def _eval(kappa: Kappa, wi: Any, wo: Any) -> Any:
    n_x, n_y, f0 = kappa
    h = half_vector(wi, wo)
    exponent = (n_x * h.x_squared + n_y * h.y_squared) / dr.maximum(h.planar_squared, PLANAR_EPS)
    lobe = exp_of_negative(exponent * log_cos_theta(h))
    scale = dr.sqrt((n_x + 1.0) * (n_y + 1.0)) * (0.125 / math.pi)
    facing = h.cos_theta_d * dr.maximum(*guarded_cosines(wi, wo))
    return scale * lobe * schlick_fresnel(f0, h.cos_theta_d) / facing


def _sample(kappa: Kappa, wo: Any, u: Sequence[Any]) -> Any:
    return reflect_about_visible(square_to_ashikhmin_shirley(u[1:], kappa[0], kappa[1]), wo, u[0])


def _pdf(kappa: Kappa, wi: Any, wo: Any) -> Any:
    h = unit_half_vector(wi, wo)
    return visible_pdf(ashikhmin_shirley_pdf(h, kappa[0], kappa[1]), h, wo)


ASHIKHMIN_SHIRLEY = Twin(_eval, _sample, _pdf)
