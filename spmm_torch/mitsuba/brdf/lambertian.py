"""Lambertian reflection in Dr.Jit."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from .base import INV_PI, Kappa, Twin
from .warp import cosine_pdf, square_to_cosine_hemisphere


def _eval(kappa: Kappa, wi: Any, wo: Any) -> Any:
    return INV_PI + 0.0 * wi.z  # as wide as the others


def sample_cosine(kappa: Kappa, wo: Any, u: Sequence[Any]) -> Any:
    """wi by the cosine, for BRDFs without a peak."""
    return square_to_cosine_hemisphere(u[1:])


def pdf_of_cosine(kappa: Kappa, wi: Any, wo: Any) -> Any:
    """Density of `sample_cosine`."""
    return cosine_pdf(wi)


LAMBERTIAN = Twin(_eval, sample_cosine, pdf_of_cosine)
