"""Blocks that are kept from call to call, and parts that several threads evaluate."""

from __future__ import annotations

import pytest
import torch
from torch import Tensor

from spmm_torch.model import ragged
from spmm_torch.runtime.threads import cpu_threads
from tests.planted.directions import random_directions
from tests.planted.models import planted_model


def queries(count: int, seed: int = 0) -> tuple[Tensor, Tensor, Tensor]:
    uv = torch.rand(count, 2, generator=torch.Generator().manual_seed(seed))
    wi, wo = (random_directions(count, seed + n, max_theta=1.5).float() for n in (1, 2))
    return uv, wi, wo


@torch.no_grad()
def test_kept_blocks_serve_queries_that_meet_no_others() -> None:
    model, given = planted_model(residual=0.1), queries(500)
    whole = model(*given)
    kept = model.kept_blocks
    assert kept is not None
    some = model(*(part[:300:2] for part in given))
    assert torch.equal(some, planted_model(residual=0.1)(*(part[:300:2] for part in given)))
    assert torch.equal(model(*given), whole)
    model.weight.mul_(0.5)
    torch.testing.assert_close(model(*given, residual=False), 0.5 * (whole - epsilon(given)))
    assert model.kept_blocks is not kept


def epsilon(given: tuple[Tensor, Tensor, Tensor]) -> Tensor:
    model = planted_model(residual=0.1)
    return model(*given) - model(*given, residual=False)


@torch.no_grad()
def test_blocks_of_centres_are_not_those_of_all_places() -> None:
    """A centre shows one texel alone: the lobes of its neighbours would cost time."""
    model = planted_model()
    model(*queries(500))
    kept = model.kept_blocks
    centres = (torch.tensor([[0.5, 2.5]]) / model.width, *(part[:1] for part in queries(1)[1:]))
    model(*centres)
    assert kept is not None and model.kept_blocks is not kept
    assert model.kept_blocks is not None and int(model.kept_blocks.blocks.count.sum()) == 3


@torch.no_grad()
def test_threads_change_no_bit(monkeypatch: pytest.MonkeyPatch) -> None:
    model, given = planted_model(residual=0.1), queries(500)
    monkeypatch.setattr(ragged, "EVALUATED_ENTRIES", 300)
    with cpu_threads(1):
        alone = model(*given)
    with cpu_threads(2):
        assert torch.equal(model(*given), alone)
    with cpu_threads(2), torch.inference_mode():
        assert torch.equal(model(*given), alone)
