"""Pairs that stand for a long list: highlights stay, and sums are right on the mean."""

from __future__ import annotations

import pytest
import torch

from spmm_torch.data.pair_lists import PairList
from spmm_torch.fit.scattered.thinned import thinned
from tests.planted.scattered import planted_values, random_pairs


def long_list(count: int) -> PairList:
    wi, wo = random_pairs(count, 5)
    values = planted_values(wi, wo)[None].clone()
    values[0, 17] = 100.0  # a highlight that one pair sees
    return PairList(torch.tensor([0]), wi, wo, values)


def test_a_short_list_stays() -> None:
    whole = long_list(50)
    found, weight = thinned(whole, 50, torch.Generator().manual_seed(0))
    assert found is whole
    assert weight is None


def test_sums_over_those_drawn_are_those_over_all() -> None:
    whole, generator = long_list(20_000), torch.Generator().manual_seed(0)
    for _ in range(3):
        found, weight = thinned(whole, 2000, generator)
        assert weight is not None
        assert abs(len(found.wi) - 2000) <= 1
        assert float(found.values.max()) == 100.0
        assert abs(float(weight.sum()) / 20_000 - 1.0) < 0.05
        total = (weight[None, :, None] * found.values.double()).sum()
        assert abs(float(total / whole.values.double().sum()) - 1.0) < 0.05
        assert torch.unique(found.wi, dim=0).shape == found.wi.shape


def test_the_first_of_the_random_order_is_drawn_as_the_others_are() -> None:
    whole, count = long_list(40), 10
    counts = []
    for seed in range(400):
        found, weight = thinned(whole, count, torch.Generator().manual_seed(seed))
        assert float(found.values.max()) == 100.0, seed  # of chance 1, wherever it stands
        counts.append(len(found.wi))
    assert sum(counts) / len(counts) == pytest.approx(count, abs=0.01)
