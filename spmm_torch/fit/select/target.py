"""What the weights of a texel are fit to beside the residual of its cluster [WDR11 §4.1].

The residual of a cluster is mean(y) - D mean(x) over its texels. It is known by its products with
the atoms, like everything else here.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor

from .products import Products


@dataclass(frozen=True)
class Target:
    """What the weights of n texels are fit to: y - weight * residual, as products with the atoms.

    Attributes:
        correlation: D^T target, `[n, J, C]`.
        energy: ||target||^2, `[n, C]`, divided among the channels as that of y.
    """

    correlation: Tensor
    energy: Tensor


def target_beside_residual(products: Products, mean: Tensor | None, weight: float) -> Target:
    """The target y - w * residual, where the residual is mean(y) - D mean(x).

    The same x fits D x to it as minimizes (1 - w) ||y - D x||^2 + w ||y - D x - residual||^2.

    Args:
        products: of the texels.
        mean: mean(x), weight of every atom, mean over the cluster, `[J, C]`; None: zeros.
        weight: w, from 0 to 1.

    Raises:
        ValueError: w is not 0 and the products have no overlap.
    """
    if weight == 0.0:
        return Target(products.correlation, products.energy)
    if products.overlap is None:
        raise ValueError("products without overlap cannot be fit beside a residual")
    if mean is None:
        mean = torch.zeros_like(products.mean_correlation)
    mean = mean.to(products.gram.dtype)
    residual = products.mean_correlation - products.gram @ mean  # D^T residual, [J, C]
    of_mean = torch.einsum("njc,jc->n", products.correlation, mean).double()
    along = products.overlap - of_mean  # <y, residual>, [n]
    own = products.mean_energy.sum()
    own = own - ((products.mean_correlation + residual) * mean).sum().double()
    before = products.energy.sum(1)
    energy = (before - 2.0 * weight * along + weight * weight * own).clamp(min=0.0)
    ratio = torch.where(before > 0.0, energy / before, 0.0)
    return Target(products.correlation - weight * residual, products.energy * ratio[:, None])


def taken_by_residual(products: Products, mean: Tensor) -> float:
    """Squared error of the whole cluster that its residual takes away, given `mean [J, C]` weights.

    The residual is mean(y) - D mean(x), so this is N times its squared norm.
    """
    mean = mean.double()
    taken = products.mean_energy.sum() - 2.0 * (mean * products.mean_correlation).sum()
    taken = taken + (mean * (products.gram.double() @ mean)).sum()
    return products.count * max(float(taken), 0.0)


def residual_weight(without: float, taken: float, texels: float) -> float:
    """The weight of the residual in the target, best for the SNR with and without it together.

    The sum of both SNR in dB is stationary where their squared errors E0 and E1 have the weights
    1 / E0 and 1 / E1. E1 is multiplied by n / (n - 1), because the residual of n texels is fit to
    them; that of one texel fits it exactly and tells nothing.

    Args:
        without: E0, squared error without the residual.
        taken: E0 - E1, what the residual takes away.
        texels: n.
    """
    if texels < 2 or without <= 0.0:
        return 0.0
    with_residual = max(without - taken, 0.0)
    if texels < math.inf:
        with_residual *= texels / (texels - 1)
    return without / (without + with_residual)
