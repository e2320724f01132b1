"""What exchanging light and view tells: whether values hold the cosine, and are linear.

A BRDF f is the same with light and view exchanged [Helmholtz reciprocity]. Values v = (f cos)^g of
exponent g then have log v(i, o) - log v(o, i) = g log(cos_i / cos_o): the slope of this line is 1
where values are linear and hold the cosine, 0 where they lack it, 1 / 2.2 where they are still
encoded for a display, and 2.2 where linear ones were decoded. The mean over texels is taken.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor

from ..geometry.neighbours import nearest

# Directions closer than this are the same, in radians.
SAME_DIRECTION = 2e-3
# Least number of exchanged pairs that a slope is guessed from.
LEAST_PAIRS = 20
# Bounds between the slopes 0, 1 / 2.2, 1 and 2 or more.
NONE, ENCODED, DOUBLED = 0.2, 0.7, 1.5


@dataclass(frozen=True)
class Exchange:
    """What exchanged pairs say.

    Attributes:
        slope: of log-ratios of values over those of cosines; None: too few pairs.
        asymmetry: median of what is left of the ratios, as a fraction; None: too few pairs.
        pairs: number of exchanged pairs.
    """

    slope: float | None
    asymmetry: float | None
    pairs: int


def exchange(mean: Tensor, light: Tensor, view: Tensor) -> Exchange:
    """Compares values with those of exchanged directions.

    Args:
        mean: mean values `[V, L]`; 0 where there is none.
        light, view: unit vectors `[L, 3]`, `[V, 3]`.
    """
    distance, beside = (found[:, 0] for found in nearest(view, light))  # [V]
    views = torch.nonzero(distance < SAME_DIRECTION).squeeze(1)  # views that are lights too
    twin = beside[views]  # [n], the light of each
    table = mean.double()[views][:, twin]  # [n, n]
    cosine = view[views, 2].double().clamp(min=1e-3).log()
    first, second = torch.triu_indices(len(views), len(views), 1)
    x = cosine[second] - cosine[first]  # light of the pair is the second
    one, other = table[first, second], table[second, first]
    used = (one > 0.0) & (other > 0.0)
    x, y = x[used], (one[used] / other[used]).log()
    tilted = x.abs() > math.log(1.05)
    count = int(tilted.sum())
    if count < LEAST_PAIRS:
        return Exchange(None, None, count)
    slope = float((x @ y) / (x @ x))
    return Exchange(slope, float((y - slope * x).abs().median().expm1()), count)
