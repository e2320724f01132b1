"""What a BRDF is in Dr.Jit, and what most of them need: the half vector, guarded cosines."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from ...brdf.base import COS_EPS, EXPONENT_MARGIN, INV_PI
from ..libraries import dr

# Exponent of the smallest number that `exp_of_negative` gives, as in torch.
LEAST_EXPONENT = math.log(2.0**-126) + EXPONENT_MARGIN

Kappa = Sequence[Any]


@dataclass(frozen=True)
class Twin:
    """A BRDF as three functions; wi and wo are above the horizon of the lobe.

    Attributes:
        eval: f_r without the cosine, in 1/sr, of kappa, wi and wo.
        sample: wi of kappa, wo and three numbers u in [0, 1).
        pdf: density of `sample`, in 1/sr, of kappa, wi and wo; wi may be under the horizon.
    """

    eval: Callable[[Kappa, Any, Any], Any]
    sample: Callable[[Kappa, Any, Sequence[Any]], Any]
    pdf: Callable[[Kappa, Any, Any], Any]


@dataclass(frozen=True)
class HalfVector:
    """Squared components and length of the half vector wi + wo, which is not normalized."""

    x_squared: Any
    y_squared: Any
    z: Any
    length_squared: Any

    @property
    def planar_squared(self) -> Any:
        """Squared length of its projection on the surface."""
        return self.x_squared + self.y_squared

    @property
    def cos_theta_d(self) -> Any:
        """Cosine of the difference angle."""
        return 0.5 * dr.sqrt(self.length_squared)


def half_vector(wi: Any, wo: Any) -> HalfVector:
    """The half vector of local wi and wo; z is at least COS_EPS."""
    x, y, z = wi.x + wo.x, wi.y + wo.y, dr.maximum(wi.z + wo.z, COS_EPS)
    return HalfVector(x * x, y * y, z, x * x + y * y + z * z)


def guarded_cosines(wi: Any, wo: Any) -> tuple[Any, Any]:
    """(cos_theta_i, cos_theta_o), at least COS_EPS, for use in denominators."""
    return dr.maximum(wi.z, COS_EPS), dr.maximum(wo.z, COS_EPS)


def exp_of_negative(exponent: Any) -> Any:
    """exp of an exponent <= 0, never 0."""
    return dr.exp(dr.maximum(exponent, LEAST_EXPONENT))


def schlick_fresnel(f0: Any, cos_theta_d: Any) -> Any:
    """Schlick's Fresnel term with f0 at normal incidence."""
    grazing = dr.maximum(1.0 - cos_theta_d, 0.0)
    squared = grazing * grazing
    return f0 + (1.0 - f0) * squared * squared * grazing


def log1p(x: Any) -> Any:
    """log(1 + x) without cancellation, for x > -1 [Kahan]; Dr.Jit has none."""
    u = 1.0 + x
    safe = dr.select(u == 1.0, 2.0, u)
    return dr.select(u == 1.0, x, dr.log(safe) * x / (safe - 1.0))


def log_cos_theta(h: HalfVector) -> Any:
    """log of the cosine of the angle of a half vector."""
    return -0.5 * log1p(h.planar_squared / (h.z * h.z))


__all__ = [
    "COS_EPS",
    "INV_PI",
    "HalfVector",
    "Kappa",
    "Twin",
    "exp_of_negative",
    "guarded_cosines",
    "half_vector",
    "log1p",
    "log_cos_theta",
    "schlick_fresnel",
]
