"""Where a lobe ends: at its own horizon for views, and below the lowest measured light."""

from __future__ import annotations

import math

import torch
from torch import Tensor

from ..geometry.grazing import grazing_fade

# Least place on the step for its logarithmic derivative: below it the step is 0 but for rounding.
LEAST_STEP = 1e-12


def view_step(cosine: Tensor, horizon: float) -> Tensor:
    """Factor of a lobe for views near its own horizon: a smooth step from 0 to 1 `[...]`.

    It is 0 on the horizon and 1 from the angle `horizon` over it, with a continuous derivative.

    Args:
        cosine: n_j . wo, `[...]`.
        horizon: width of the step in radians; 0 for a hard one.
    """
    if horizon == 0.0:
        return (cosine > 0.0).to(cosine.dtype)
    t = (cosine / math.sin(horizon)).clamp(0.0, 1.0)
    return t * t * (3.0 - 2.0 * t)


def view_step_with_slope(cosine: Tensor, horizon: float) -> tuple[Tensor, Tensor]:
    """`view_step` and its logarithmic derivative, `[...]` each; finite where the step is 0."""
    if horizon == 0.0:
        return view_step(cosine, horizon), torch.zeros_like(cosine)
    t = (cosine / math.sin(horizon)).clamp(0.0, 1.0)
    fall = 3.0 - 2.0 * t
    slope = 6.0 * (1.0 - t) / (t.clamp(min=LEAST_STEP) * fall) / math.sin(horizon)
    return t * t * fall, slope


def lit_cosine(cosine: Tensor, upright: Tensor, of_texel: Tensor, lowest: float) -> Tensor:
    """n_j . wi of lobes `[J, ...]`, without what their tilt adds where light grazes the texel.

    Their excess over an upright lobe, n_j . wi - n_j.z wi.z, fades below the lowest measured light.
    So lobes end at the horizon of the texel, upright ones are never changed, and at measured lights
    each keeps its cosine to the bit.

    Args:
        cosine: n_j . wi, not negative, `[J, ...]`.
        upright: z of the normals in texel coordinates, `[J, ...]`.
        of_texel: z of wi in texel coordinates, `[1 or J, ...]`.
        lowest: z of the lowest measured light; 0 changes nothing.
    """
    if lowest == 0.0:
        return cosine
    excess = (cosine - upright * of_texel).clamp(min=0.0)
    return cosine - (1.0 - grazing_fade(of_texel, lowest)) * excess
