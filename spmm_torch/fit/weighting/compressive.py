"""Weights that make squared errors those of compressed values, about.

Squared errors of reflectance are ruled by grazing highlights. Errors of its cube root [Low et al.
2012, BRDF models for accurate and efficient rendering of glossy surfaces] or logarithm [Sztrajman
et al. 2021] are not: (g(y) - g(s))^2 ~ g'(y)^2 (y - s)^2, a weighted squared error. With a weight
for each value, every texel would have a Gram matrix of its own, and no product would be shared any
more. So this is the separable form: the weight of a pair is g'^2 at the mean value of the pair,
over all texels and channels. It evens out highlights against the rest, not bright texels against
dark ones.
"""

from __future__ import annotations

import torch
from torch import Tensor

from ...data import BTF
from ...data.blocks import block_texels
from ...data.error_weights import Weights
from ...runtime.memory import slices
from ...runtime.ranks import ALONE, Ranks

# Minus the exponent of g'(y)^2: y^(1/3) has 2 (1 - 1/3), log(y) has 2.
EXPONENTS = {"cube-root": 4.0 / 3.0, "log": 2.0}
# Share of the mean value that is added to all: what is darker is as good as black.
DARK = 0.01


def compressive_weights(
    btf: BTF, error: str, device: torch.device, ranks: Ranks = ALONE
) -> Weights:
    """The weights of one kind of `error`: l2 (none), cube-root or log.

    Passes over all values once, but for l2.
    """
    if error == "l2":
        return Weights(measured=btf.measured)
    size = mean_values(btf, device, ranks)  # [D]
    measured = torch.ones(len(size), dtype=torch.bool) if btf.measured is None else btf.measured
    dark = DARK * size[measured].mean()
    pair = (size + dark) ** -EXPONENTS[error]
    return Weights.build(btf, pair.view(len(btf.view), len(btf.light)))


def mean_values(btf: BTF, device: torch.device, ranks: Ranks = ALONE) -> Tensor:
    """The mean of every direction pair over texels and channels, `[D]` float64."""
    total = torch.zeros(btf.pair_count, dtype=torch.float64, device=device)
    blocks = list(slices(btf.texel_count, block_texels(btf, device)))
    for block in blocks[ranks.rank :: ranks.size]:
        total += btf.signals(block, device).sum((0, 1), dtype=torch.float64)
    return ranks.sum(total).cpu() / (btf.texel_count * btf.channels)
