"""Weights that turn squared errors into those of compressed values, approximately.

Grazing highlights rule the squared error of reflectance, but not that of its cube root [LKYU12] or
logarithm [SRRW21]: (g(y) - g(s))^2 ~ g'(y)^2 (y - s)^2 is a weighted squared error. A weight for
each value would give every texel a Gram matrix of its own. The weights are therefore separable: a
pair has the weight g'^2 at its mean value over all texels and channels. This balances highlights
against other pairs, but not bright texels against dark ones. Balanced errors are the sum of the
relative squared errors of values and of their cube roots. Unrelated materials count in units of
their own: else the brightest would rule what is relative for all.

References:
    [LKYU12] Joakim Low, Joel Kronander, Anders Ynnerman, Jonas Unger, BRDF Models for Accurate and
        Efficient Rendering of Glossy Surfaces, ACM Transactions on Graphics 31(1), 2012.
    [SRRW21] Alejandro Sztrajman, Gilles Rainer, Tobias Ritschel, Tim Weyrich, Neural BRDF
        Representation and Importance Sampling, Computer Graphics Forum 40(6), 2021.
"""

from __future__ import annotations

import torch
from torch import Tensor

from ...data import BTF
from ...data.blocks import block_texels
from ...data.error_weights import Weights
from ...data.pair_lists import PairedBTF
from ...runtime.memory import slices
from ...runtime.ranks import ALONE, Ranks
from ..glossy.compression import Compression, own_units
from ..glossy.objective import Objective


def compression(
    btf: BTF, objective: Objective, device: torch.device, ranks: Ranks = ALONE
) -> Compression | None:
    """What an objective makes of values, by one pass over them; None where it takes them as are.

    Black values are taken so by every objective.
    """
    if objective.plain:
        return None
    apart = btf.names is not None and btf.texel_count > 1
    size = mean_values(btf, device, ranks, apart=apart)  # [D]
    if not bool((size > 0.0).any()):  # of black values none is brighter than another
        return None
    every = torch.ones(len(size), dtype=torch.bool)
    measured = every if btf.measured is None else btf.measured
    error, listed = objective.error, isinstance(btf, PairedBTF)
    return Compression.of(
        error, size, measured, len(btf.view), objective.pair, apart=apart, listed=listed
    )


def compressive_weights(
    btf: BTF, objective: Objective, device: torch.device, ranks: Ranks = ALONE
) -> Weights:
    """The weights of an objective; one pass over all values if it compresses them."""
    found = compression(btf, objective, device, ranks)
    return Weights(measured=btf.measured) if found is None else found.weights(btf)


def mean_values(
    btf: BTF, device: torch.device, ranks: Ranks = ALONE, *, apart: bool = False
) -> Tensor:
    """Mean value of every direction pair over texels and channels, `[D]` float64.

    Args:
        btf: decoded.
        device: of the computation.
        ranks: that share the work.
        apart: whether each texel counts in its own unit, see `own_units`.
    """
    total = torch.zeros(btf.pair_count, dtype=torch.float64, device=device)
    blocks = list(slices(btf.texel_count, block_texels(btf, device)))
    for block in blocks[ranks.rank :: ranks.size]:
        values = btf.signals(block, device)
        values = values / own_units(values) if apart else values
        total += values.sum((0, 1), dtype=torch.float64)
    return ranks.sum(total).cpu() / (btf.texel_count * btf.channels)
