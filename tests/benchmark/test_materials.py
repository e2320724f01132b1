"""Repeated texels as the source of a large BTF."""

from __future__ import annotations

import torch

from spmm_torch.benchmark.materials import TiledStore
from spmm_torch.data import load_btf
from spmm_torch.data.readers import sample_path


def test_strips_are_the_values_of_one_view() -> None:
    base = load_btf(sample_path()).load().store()
    gain = torch.rand(3, 3, generator=torch.Generator().manual_seed(0))
    store = TiledStore(base, torch.tensor([3, 5, 9]), gain)
    texel, view = torch.tensor([0, 2]), torch.tensor([7, 1])
    whole = store.texels(None).unflatten(1, (81, 81))
    assert torch.equal(store.strips(texel, view, 81), whole[texel, view])
