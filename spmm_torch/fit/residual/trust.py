"""How far the residual at each pair of directions may be interpolated: what its neighbours say.

A residual is stored at measured pairs and interpolated between them. Where it is smooth, that
brings the model nearer to the truth; at a peak between whose samples nothing is known, it spreads
the error of one sample over all that lies around it. So each pair is left out in turn and told from
its neighbours: what they do not foresee is not kept [Sto74].

References:
    [Sto74] Mervyn Stone, Cross-Validatory Choice and Assessment of Statistical Predictions, Journal
        of the Royal Statistical Society B 36(2), 1974.
"""

from __future__ import annotations

import torch
from torch import Tensor

# Neighbours from which a pair is told, by inverse squared distance.
NEIGHBOURS = 4
# Least squared distance of two directions, and least energy, far under that of measured ones.
LEAST_DISTANCE, LEAST_ENERGY = 1e-8, 1e-30


def trust(functions: Tensor, light: Tensor, view: Tensor) -> Tensor:
    """The share of the residual to keep at each pair, 0 to 1, `[V, L]`.

    With the light, and then the view, left out, it is the share k of least squared error
    ||k r - p||^2, where r is the residual and p what its neighbours foresee.

    Args:
        functions: of the residual, `[V, R, L, C]`.
        light, view: measured directions, `[L, 3]` and `[V, 3]`.
    """
    by_light = torch.einsum("lm,vrmc->vrlc", _neighbours(light).to(functions), functions)
    by_view = torch.einsum("vw,wrlc->vrlc", _neighbours(view).to(functions), functions)
    energy = functions.square().sum((1, 3)).clamp(min=LEAST_ENERGY)  # [V, L]
    shares = [(told * functions).sum((1, 3)) / energy for told in (by_light, by_view)]
    return torch.minimum(*shares).clamp(0.0, 1.0)


def _neighbours(directions: Tensor) -> Tensor:
    """Weights `[N, N]` of the neighbours from which each of `directions [N, 3]` is told."""
    distance = torch.cdist(directions.double(), directions.double()).square()
    distance = distance.fill_diagonal_(torch.inf)
    count = min(NEIGHBOURS, len(directions) - 1)
    least = distance.topk(count, dim=1, largest=False)
    weight = 1.0 / least.values.clamp(min=LEAST_DISTANCE)
    weight = weight / weight.sum(1, keepdim=True)
    return torch.zeros_like(distance).scatter_(1, least.indices, weight)
