"""Weights of samples that lie unevenly: each counts by the directions that it stands for."""

from __future__ import annotations

import torch

from spmm_torch.data.pair_lists import PairedBTF, PairList
from spmm_torch.fit.glossy.objective import Objective
from spmm_torch.fit.scattered.weights import list_weights, volumes
from tests.planted.scattered import random_pairs

CPU = torch.device("cpu")


def unit(vectors: torch.Tensor) -> torch.Tensor:
    return torch.nn.functional.normalize(vectors, dim=1)


def uneven() -> tuple[torch.Tensor, torch.Tensor]:
    """2,000 pairs everywhere, and as many within a few degrees of one pair."""
    wi, wo = random_pairs(2000, 1)
    noise = 0.05 * torch.randn(2, 2000, 3, generator=torch.Generator().manual_seed(0))
    up = torch.tensor([0.1, 0.2, 1.0])
    return torch.cat((wi, unit(up + noise[0]))), torch.cat((wo, unit(up + noise[1])))


def test_dense_samples_have_the_volume_of_where_they_lie() -> None:
    volume = volumes(*uneven())
    assert float(volume[2000:].sum() / volume.sum()) < 0.01
    even = volumes(*random_pairs(4000, 1))
    assert float(even.std() / even.mean()) < 1.0
    assert volumes(*random_pairs(1, 1)).tolist() == [1.0]


def test_only_compressed_errors_count_by_volume() -> None:
    wi, wo = uneven()
    btf = PairedBTF.of(PairList(torch.tensor([0]), wi, wo, torch.ones(1, 4000, 3)))
    assert list_weights(btf, Objective("l2"), CPU).uniform
    pair = list_weights(btf, Objective("cube-root"), CPU).pair
    assert pair is not None
    assert float(pair[2000:].sum() / pair.sum()) < 0.01
    drawn = list_weights(btf, Objective("l2"), CPU, torch.arange(1.0, 4001.0).double()).pair
    assert drawn is not None
    torch.testing.assert_close(drawn / drawn[0], torch.arange(1.0, 4001.0))
