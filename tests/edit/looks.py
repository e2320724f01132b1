"""What a model shows under a few directions, and whether it is valid."""

from __future__ import annotations

import torch
from torch import Tensor

from spmm_torch import SPMM
from spmm_torch.edit.entries import entry_texels
from spmm_torch.lobes.sampling import LobeTable, lobe_intensity

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


def albedo(model: SPMM) -> Tensor:
    """Mean of each texel's lobes over all lights and views, `[T, C]`, by many samples."""
    lobes = model.dictionary.detach()
    mean = lobe_intensity(lobes, LobeTable.build(lobes), 8192)
    value = model.weight.detach() * mean[model.index, None]
    return torch.zeros(model.texel_count, 3).index_add(0, entry_texels(model), value)
