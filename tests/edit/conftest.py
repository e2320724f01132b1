"""A small model with lobes of all kinds and a residual, which no edit may change."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
import torch

from spmm_torch import SPMM
from tests.planted.models import FEW_RINGS, planted_model, with_components


@pytest.fixture
def model() -> Iterator[SPMM]:
    """8 x 8 texels, 3 lobes each, 2 clusters in vertical stripes."""
    yield from unchanged(planted_model(rings=FEW_RINGS, residual=0.05))


@pytest.fixture
def rank_model() -> Iterator[SPMM]:
    """The same with 3 components in place of the residual of clusters."""
    yield from unchanged(with_components(planted_model(rings=FEW_RINGS)))


def unchanged(planted: SPMM) -> Iterator[SPMM]:
    """The model, and a check of its bits afterwards."""
    before = {name: tensor.clone() for name, tensor in planted.state_dict().items()}
    yield planted
    for name, tensor in planted.state_dict().items():
        assert torch.equal(tensor, before[name]), f"an edit has changed {name} of its argument"
