"""Pairs of a long list that stand for all of it, drawn by their energy.

A search holds many lobes at all pairs at once. Pairs drawn evenly would miss highlights, which few
pairs see: half of the chance is by energy, half even. Each pair drawn has the inverse of its chance
as weight, so that sums over those drawn are, on the mean, sums over all [HT52].

References:
    [HT52] Daniel G. Horvitz, Donovan J. Thompson, A Generalization of Sampling Without Replacement
        from a Finite Universe, Journal of the American Statistical Association 47(260), 1952.
"""

from __future__ import annotations

import torch
from torch import Tensor

from ...data.pair_lists import PairList

# Rounds in which chances above 1 are cut and the rest raised: each leaves fewer.
ROUNDS = 50


def thinned(
    pairs: PairList, count: int, generator: torch.Generator
) -> tuple[PairList, Tensor | None]:
    """About `count` pairs of a list, and the weight of each `[d]`; all, and None, if it is short.

    Args:
        pairs: D pairs and their texels.
        count: pairs wanted.
        generator: of the choice.
    """
    if len(pairs.wi) <= count:
        return pairs, None
    chance = _chances(pairs.values, count)
    order = torch.randperm(len(chance), generator=generator)
    run = chance[order].cumsum(0) + torch.rand((), generator=generator, dtype=torch.float64)
    drawn = order[torch.cat((run.new_zeros(1), run)).floor().diff() > 0.0].sort().values
    return pairs.at(drawn), 1.0 / chance[drawn]


def _chances(values: Tensor, count: int) -> Tensor:
    """Chance of each pair `[D]` float64, of sum `count`, by its energy in values `[n, D, C]`."""
    energy = torch.linalg.vector_norm(values, dim=(0, 2)).double().square()
    even = torch.full_like(energy, 1.0 / len(energy))
    share = 0.5 * (even + energy / energy.sum()) if bool(energy.any()) else even
    chance = (count * share).clamp(max=1.0)
    for _ in range(ROUNDS):
        free = chance < 1.0
        left = count - float((~free).sum())
        raised = chance * (left / float(chance[free].sum()))
        if bool((raised[free] <= 1.0).all()):
            return torch.where(free, raised, 1.0)
        chance = torch.where(free, raised.clamp(max=1.0), 1.0)
    return chance
