"""A small model with lobes of all kinds and a residual, which no edit may change."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
import torch

from spmm_torch import SPMM
from tests.planted.models import FEW_RINGS, planted_model


@pytest.fixture
def model() -> Iterator[SPMM]:
    """8 x 8 texels, 3 lobes each, 2 clusters in vertical stripes."""
    planted = planted_model(rings=FEW_RINGS, residual=0.05)
    before = {name: tensor.clone() for name, tensor in planted.state_dict().items()}
    yield planted
    for name, tensor in planted.state_dict().items():
        assert torch.equal(tensor, before[name]), f"an edit has changed {name} of its argument"
