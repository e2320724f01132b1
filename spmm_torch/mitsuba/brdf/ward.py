"""Ward and Ward-Duer in Dr.Jit."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from ..libraries import dr
from .base import Kappa, Twin, exp_of_negative, guarded_cosines, half_vector
from .visible import reflect_about_visible, unit_half_vector, visible_pdf
from .warp import beckmann_pdf, square_to_beckmann


def _peak(kappa: Kappa, wi: Any, wo: Any) -> Any:
    """The lobe without the factor of the cosines."""
    h = half_vector(wi, wo)
    slope = h.x_squared / (kappa[0] * kappa[0]) + h.y_squared / (kappa[1] * kappa[1])
    return exp_of_negative(-slope / (h.z * h.z)) / (4.0 * math.pi * kappa[0] * kappa[1])


def _eval(kappa: Kappa, wi: Any, wo: Any) -> Any:
    cos_theta_i, cos_theta_o = guarded_cosines(wi, wo)
    return _peak(kappa, wi, wo) * dr.rsqrt(cos_theta_i * cos_theta_o)


def _eval_duer(kappa: Kappa, wi: Any, wo: Any) -> Any:
    cos_theta_i, cos_theta_o = guarded_cosines(wi, wo)
    return _peak(kappa, wi, wo) / (cos_theta_i * cos_theta_o)


def _sample(kappa: Kappa, wo: Any, u: Sequence[Any]) -> Any:
    return reflect_about_visible(square_to_beckmann(u[1:], kappa[0], kappa[1]), wo, u[0])


def _pdf(kappa: Kappa, wi: Any, wo: Any) -> Any:
    h = unit_half_vector(wi, wo)
    return visible_pdf(beckmann_pdf(h, kappa[0], kappa[1]), h, wo)


WARD = Twin(_eval, _sample, _pdf)
WARD_DUER = Twin(_eval_duer, _sample, _pdf)
