"""Cook-Torrance in Dr.Jit."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from ..libraries import dr
from .base import (
    INV_PI,
    Kappa,
    Twin,
    exp_of_negative,
    guarded_cosines,
    half_vector,
    schlick_fresnel,
)
from .visible import reflect_about_visible, unit_half_vector, visible_pdf
from .warp import beckmann_pdf, square_to_beckmann


def _eval(kappa: Kappa, wi: Any, wo: Any) -> Any:
    alpha_squared = kappa[0] * kappa[0]
    cos_theta_i, cos_theta_o = guarded_cosines(wi, wo)
    h = half_vector(wi, wo)
    z_squared = h.z * h.z
    sec_squared = h.length_squared / z_squared
    tan_squared = h.planar_squared / z_squared
    beckmann = exp_of_negative(-tan_squared / alpha_squared) * sec_squared * sec_squared
    groove = 4.0 * h.z / h.length_squared * dr.minimum(cos_theta_i, cos_theta_o)
    scale = 0.25 * INV_PI / (alpha_squared * cos_theta_i * cos_theta_o)
    fresnel = schlick_fresnel(kappa[1], h.cos_theta_d)
    return scale * beckmann * fresnel * dr.minimum(groove, 1.0)


def _sample(kappa: Kappa, wo: Any, u: Sequence[Any]) -> Any:
    return reflect_about_visible(square_to_beckmann(u[1:], kappa[0], kappa[0]), wo, u[0])


def _pdf(kappa: Kappa, wi: Any, wo: Any) -> Any:
    h = unit_half_vector(wi, wo)
    return visible_pdf(beckmann_pdf(h, kappa[0], kappa[0]), h, wo)


COOK_TORRANCE = Twin(_eval, _sample, _pdf)
