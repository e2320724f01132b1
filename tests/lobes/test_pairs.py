"""Chosen lobes at chosen directions, against one lobe at a time."""

from __future__ import annotations

import math

import pytest
import torch
from torch import Tensor

from spmm_torch.brdf import MODEL_NAMES
from spmm_torch.geometry.directions import direction_from_angles
from spmm_torch.lobes.batch import LobeBatch
from spmm_torch.lobes.pairs import PairRows, eval_pairs
from tests.planted.lobes import random_lobes

LOBES, QUERIES = 19, 50


def seeded(seed: int) -> torch.Generator:
    return torch.Generator().manual_seed(seed)


def lobes(dtype: torch.dtype = torch.float32) -> LobeBatch:
    """Of all models, in an order that mixes them."""
    names = [MODEL_NAMES[3 * lobe % len(MODEL_NAMES)] for lobe in range(LOBES)]
    return random_lobes(names, seeded(1), dtype=dtype)


def directions(seed: int, dtype: torch.dtype = torch.float32) -> Tensor:
    """Some of them under the horizon."""
    theta, phi = torch.rand(2, QUERIES, generator=seeded(seed), dtype=dtype)
    return direction_from_angles(1.8 * theta, 2.0 * math.pi * phi)


def one_by_one(batch: LobeBatch, lobe: Tensor, query: Tensor, wi: Tensor, wo: Tensor) -> Tensor:
    return torch.stack(
        [batch[j[None]].eval(wi[None, q], wo[None, q])[0] for j, q in zip(lobe, query, strict=True)]
    )


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
@pytest.mark.parametrize("pairs", [1, 7, 3000])
def test_pairs_are_single_lobes(pairs: int, dtype: torch.dtype) -> None:
    """With lobes that nobody asks for, and pairs that come twice."""
    lobe = torch.randint(2, LOBES, (pairs,), generator=seeded(2))
    query = torch.randint(0, QUERIES, (pairs,), generator=seeded(3))
    wi, wo = directions(4, dtype), directions(5, dtype)
    expected = one_by_one(lobes(dtype), lobe, query, wi, wo)
    found = eval_pairs(lobes(dtype), lobe, query, wi, wo)
    assert found.dtype == dtype and bool((expected > 0.0).any()) == (pairs > 1)
    tight = {torch.float32: 2e-6, torch.float64: 1e-13}[dtype]
    torch.testing.assert_close(found, expected, rtol=tight, atol=tight)


def test_no_pairs() -> None:
    none = torch.zeros(0, dtype=torch.long)
    assert eval_pairs(lobes(), none, none, directions(4), directions(5)).shape == (0,)


def test_block_size_changes_nothing() -> None:
    lobe = torch.randint(0, LOBES, (2000,), generator=seeded(2))
    query = torch.randint(0, QUERIES, (2000,), generator=seeded(3))
    arguments = (lobes(), lobe, query, directions(4), directions(5))
    whole = eval_pairs(*arguments)
    assert torch.equal(eval_pairs(*arguments, block=1), whole)


def test_gradients_are_those_of_single_lobes() -> None:
    """Of directions too, which several pairs share."""
    lobe = torch.randint(0, LOBES, (200,), generator=seeded(2))
    query = torch.randint(0, QUERIES, (200,), generator=seeded(3))
    batch, gradients = lobes(torch.float64), []
    for work in (eval_pairs, one_by_one):
        kappa, normal = (x.clone().requires_grad_() for x in (batch.kappa, batch.normal))
        wi, wo = (directions(seed, torch.float64).requires_grad_() for seed in (4, 5))
        value = work(LobeBatch(batch.model, kappa, normal, batch.angle), lobe, query, wi, wo)
        gradients.append(torch.autograd.grad(value.square().sum(), (kappa, normal, wi, wo)))
    for found, expected in zip(*gradients, strict=True):
        torch.testing.assert_close(found, expected)


def test_rows_of_shared_lists_are_those_of_their_pairs() -> None:
    """Of lists that are empty, and of lists that no query shares."""
    model = lobes().model
    count = torch.tensor([3, 0, 5, 1, 4, 2])
    queries = torch.tensor([4, 2, 0, 30, 1, 9])
    generator = seeded(7)
    lists = [torch.randperm(LOBES, generator=generator)[:n] for n in count.tolist()]
    each = [own for own, n in zip(lists, queries.tolist(), strict=True) for _ in range(n)]
    query = torch.cat([torch.full_like(own, q) for q, own in enumerate(each)])
    expected = PairRows.build(model, torch.cat(each), query)
    found, entry = PairRows.of_lists(model, torch.cat(lists), count, queries)
    assert torch.equal(torch.cat(lists)[entry.long()], torch.cat(each))
    for name in ("lobe", "query", "place"):
        assert torch.equal(getattr(found, name).long(), getattr(expected, name)), name
