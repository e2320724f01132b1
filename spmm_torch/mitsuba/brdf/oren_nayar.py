"""Oren-Nayar in Dr.Jit."""

from __future__ import annotations

from typing import Any

from ..libraries import dr
from .base import INV_PI, Kappa, Twin, guarded_cosines
from .lambertian import pdf_of_cosine, sample_cosine


def _eval(kappa: Kappa, wi: Any, wo: Any) -> Any:
    sigma_squared = kappa[0] * kappa[0]
    a = 1.0 - 0.5 * sigma_squared / (sigma_squared + 0.33)
    b = 0.45 * sigma_squared / (sigma_squared + 0.09)
    swing = dr.maximum(wi.x * wo.x + wi.y * wo.y, 0.0) / dr.maximum(*guarded_cosines(wi, wo))
    return INV_PI * (a + b * swing)


OREN_NAYAR = Twin(_eval, sample_cosine, pdf_of_cosine)
