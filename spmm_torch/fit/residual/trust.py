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

from ...geometry.neighbours import nearest

# Neighbours from which a pair is told, by inverse squared distance.
NEIGHBOURS = 4
# Least squared distance of two directions, and least energy, far under that of measured ones.
LEAST_DISTANCE, LEAST_ENERGY = 1e-8, 1e-30


def trust(functions: Tensor, light: Tensor, view: Tensor) -> Tensor:
    """The share of the residual to keep at each pair, 0 to 1, `[V, L]`.

    It is the share k of least squared error ||k r - p||^2 + ||k r - q||^2, where r is the residual
    and p and q are what its neighbours foresee with the light, and with the view, left out.

    Args:
        functions: of the residual, `[V, R, L, C]`.
        light, view: measured directions, `[L, 3]` and `[V, 3]`.
    """
    by_light, by_view = _foreseen(functions, light, 2), _foreseen(functions, view, 0)
    energy = functions.square().sum((1, 3)).clamp(min=LEAST_ENERGY)  # [V, L]
    told = ((by_light + by_view) * functions).sum((1, 3))
    return (0.5 * told / energy).clamp(0.0, 1.0)


def _foreseen(functions: Tensor, directions: Tensor, axis: int) -> Tensor:
    """What the neighbours of each of `directions [N, 3]` say, `[V, R, L, C]`; 0 where it has none.

    Args:
        functions: `[V, R, L, C]`.
        directions: along the `axis` of functions.
        axis: 0 for views, 2 for lights.
    """
    weight, index = _neighbours(directions)
    total = torch.zeros_like(functions)
    shape = [-1 if dim == axis else 1 for dim in range(4)]
    for some, which in zip(weight.to(functions).T, index.T, strict=True):
        total += some.view(shape) * functions.index_select(axis, which)
    return total


def _neighbours(directions: Tensor) -> tuple[Tensor, Tensor]:
    """(weight, index), both `[N, n]`, of the n others from which each of N directions is told."""
    count = min(NEIGHBOURS, len(directions) - 1)
    distance, index = nearest(directions, directions, count + 1)
    itself = torch.arange(len(index), device=index.device)[:, None]
    # Of directions that are given twice, either may be found first: itself counts at no rank.
    weight = 1.0 / distance.square().clamp(min=LEAST_DISTANCE) * (index != itself)
    return weight / weight.sum(1, keepdim=True).clamp(min=LEAST_ENERGY), index
