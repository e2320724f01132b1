"""Lafortune: the generalized cosine lobe."""

from __future__ import annotations

import math

import torch
from torch import Tensor

from .base import Parameter, above_horizon

# The lobe's base is raised to a power through its logarithm, so it is kept above zero.
BASE_EPS = 1e-6


class Lafortune:
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

    name = "lafortune"
    parameters = (
        Parameter("c_xy", -2.0, 2.0, "linear", "Cx / Cz, direction of the lobe"),
        # The lobe is a cosine power of wi itself, which turns twice as far as the half vector.
        Parameter(
            "exponent", 0.1, 2500.0, "log", "sharpness of the lobe", lambda width: 0.5 / width**2
        ),
    )
    anisotropic = False
    reciprocal = True

    def eval(self, kappa: Tensor, wi: Tensor, wo: Tensor) -> Tensor:
        """f_r in 1/sr; see `BRDF.eval`."""
        c_xy, n = kappa[..., 0], kappa[..., 1]
        planar = wi[..., 0] * wo[..., 0] + wi[..., 1] * wo[..., 1]
        base = (c_xy * planar + wi[..., 2] * wo[..., 2]) / c_xy.abs().clamp(min=1.0)
        lobe = torch.exp(n * torch.log(base.clamp(min=BASE_EPS)))
        lit = above_horizon(wi, wo) & (base > BASE_EPS)
        return (n + 2.0) / (2.0 * math.pi) * lobe * lit
