"""Lafortune in Dr.Jit."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from ...brdf.lafortune import BASE_EPS
from ..libraries import dr, mi
from .base import Kappa, Twin, exp_of_negative
from .warp import power_cosine_pdf, square_to_power_cosine


def _eval(kappa: Kappa, wi: Any, wo: Any) -> Any:
    c_xy, n = kappa[0], kappa[1]
    planar = wi.x * wo.x + wi.y * wo.y
    base = (c_xy * planar + wi.z * wo.z) / dr.maximum(dr.abs(c_xy), 1.0)
    lobe = exp_of_negative(n * dr.log(dr.maximum(base, BASE_EPS)))
    return dr.select(base > BASE_EPS, (n + 2.0) * (0.5 / math.pi) * lobe, 0.0)


def _sample(kappa: Kappa, wo: Any, u: Sequence[Any]) -> Any:
    about_z = square_to_power_cosine(u[1:], kappa[1])
    tangent, bitangent, axis = _about_axis(kappa[0], wo)
    return about_z.x * tangent + about_z.y * bitangent + about_z.z * axis


def _pdf(kappa: Kappa, wi: Any, wo: Any) -> Any:
    rows = _about_axis(kappa[0], wo)
    return power_cosine_pdf(mi.Vector3f(*(dr.dot(row, wi) for row in rows)), kappa[1])


def _about_axis(c_xy: Any, wo: Any) -> tuple[Any, Any, Any]:
    """A frame about the axis of the lobe, (C wo.x, C wo.y, wo.z)."""
    axis = dr.normalize(mi.Vector3f(c_xy * wo.x, c_xy * wo.y, wo.z))
    scale = 1.0 / (1.0 + axis.z)
    shear = -axis.x * axis.y * scale
    tangent = mi.Vector3f(1.0 - axis.x * axis.x * scale, shear, -axis.x)
    return tangent, mi.Vector3f(shear, 1.0 - axis.y * axis.y * scale, -axis.y), axis


LAFORTUNE = Twin(_eval, _sample, _pdf)
