"""Blinn-Phong in Dr.Jit."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from ..libraries import dr
from .base import Kappa, Twin, exp_of_negative, half_vector, log_cos_theta
from .visible import reflect_about_visible, unit_half_vector, visible_pdf
from .warp import power_cosine_pdf, square_to_power_cosine


def _eval(kappa: Kappa, wi: Any, wo: Any) -> Any:
    n = kappa[0]
    scale = (n + 2.0) * (n + 4.0) / (8.0 * math.pi * (dr.exp2(-0.5 * n) + n))
    return scale * exp_of_negative(n * log_cos_theta(half_vector(wi, wo)))


def _sample(kappa: Kappa, wo: Any, u: Sequence[Any]) -> Any:
    return reflect_about_visible(square_to_power_cosine(u[1:], kappa[0] + 1.0), wo, u[0])


def _pdf(kappa: Kappa, wi: Any, wo: Any) -> Any:
    h = unit_half_vector(wi, wo)
    return visible_pdf(power_cosine_pdf(h, kappa[0] + 1.0), h, wo)


BLINN_PHONG = Twin(_eval, _sample, _pdf)
