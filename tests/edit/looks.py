"""What a model shows under a few directions, and whether it is valid."""

from __future__ import annotations

import torch
from torch import Tensor

from spmm_torch import SPMM

PAIRS = ((0, 0), (3, 5), (9, 2), (14, 14))


@torch.no_grad()
def look(model: SPMM, residual: bool = True) -> Tensor:
    """Pictures of all texels `[pairs, T, C]`."""
    pictures = [model.picture(model.light[a], model.view[b], residual) for a, b in PAIRS]
    return torch.stack(pictures).flatten(1, 2)


def check_valid(model: SPMM) -> None:
    """Weights and values are finite, no weight is negative, and the model survives a file."""
    assert bool((model.weight >= 0.0).all())
    assert bool(model.weight.isfinite().all())
    assert bool(look(model).isfinite().all())
    again = SPMM.from_tensors(*model.to_tensors())
    assert torch.equal(look(again), look(model))
    assert model.labels.max() < model.cluster_count
