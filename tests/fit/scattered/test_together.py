"""Short lists that are fit at once have the lobes and weights of lists that are fit alone."""

from __future__ import annotations

import torch

from spmm_torch import FitConfig
from spmm_torch.data.pair_lists import PairedBTF, PairList
from spmm_torch.fit.glossy.objective import Objective
from spmm_torch.fit.problem import Problem
from spmm_torch.fit.scattered.select import fit_list, fit_lists
from spmm_torch.fit.scattered.weights import list_weights
from spmm_torch.runtime.context import Context
from tests.planted.scattered import LOBES, planted_values, random_pairs


def one_list(texel: int, pairs: int) -> PairList:
    """A texel under pairs of its own."""
    wi, wo = random_pairs(pairs, 1 + texel)
    return PairList(torch.tensor([texel]), wi, wo, planted_values(wi, wo, texel)[None])


def test_lists_of_several_lengths() -> None:
    parts = [one_list(texel, pairs) for texel, pairs in enumerate((40, 23, 40, 31, 5, 22))]
    context, objective = Context.build("cpu"), Objective("balanced")
    own = PairedBTF.of(parts[0])
    weights = list_weights(own, objective, context.device)
    problem = Problem.build(own, weights, FitConfig(), context, objective)
    together = {
        int(texel): (fit.index[row], fit.weights[row])
        for fit in fit_lists(parts, LOBES, problem)
        for row, texel in enumerate(fit.texels)
    }
    assert sorted(together) == list(range(len(parts)))
    for part in parts:
        (alone,) = fit_list(part, LOBES, problem)
        dense = []
        for index, weight in ((alone.index[0], alone.weights[0]), together[int(part.texels)]):
            used = index >= 0
            every = torch.zeros(len(LOBES), 3)
            dense.append(every.index_put((index[used],), weight[used]))
        assert torch.allclose(*dense, rtol=1e-3, atol=1e-5)
        assert bool(dense[0].any())
