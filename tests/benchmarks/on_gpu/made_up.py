"""BTFs of any size out of the bundled sample, and a model of any size out of nothing."""

from __future__ import annotations

from dataclasses import replace
from typing import cast

import torch

from spmm_torch import BTF, SPMM, load_btf
from spmm_torch.data import Selection, sample_path
from spmm_torch.data.codes import MemoryCodes
from spmm_torch.data.store import CodeStore
from spmm_torch.runtime.memory import slices
from tests.planted.models import planted_model, with_components

# Texels of the sample that are scaled at once; the darkest scale of a texel.
CHUNK, DARKEST = 2048, 0.6
LOBES, CLUSTERS, CLUSTER_LOBES, RANK = 8, 16, 24, 16


def sample(selection: Selection) -> BTF:
    """The bundled sample, or a part of it, decoded."""
    return load_btf(sample_path(), selection=selection).load()


def tiled(source: BTF, side: int) -> BTF:
    """A BTF of `side` x `side` texels: copies of the source, each texel scaled by its own factor.

    Args:
        source: decoded, of codes of 8 bits.
        side: rows and columns.
    """
    store = cast(CodeStore, source.store())
    own = store.codes.rows(None)  # [T, D, B]
    row, column = torch.arange(side) % source.height, torch.arange(side) % source.width
    texel = (row[:, None] * source.width + column).flatten()
    scale = torch.rand(len(texel), generator=torch.Generator().manual_seed(side))
    scale = (256 * (DARKEST + (1.0 - DARKEST) * scale)).to(torch.int16)[:, None, None]
    codes = torch.empty(len(texel), *own.shape[1:], dtype=own.dtype)
    for part in slices(len(texel), CHUNK):
        codes[part] = (own[texel[part]].to(torch.int16) * scale[part] >> 8).to(own.dtype)
    made = replace(store, codes=MemoryCodes(codes))
    larger = source.over(lambda _part, _loading: made)
    return replace(larger, name=f"tiled{side}", path="", height=side, width=side).load()


def model(side: int) -> SPMM:
    """A model of `side` x `side` texels of 8 lobes each, with a residual of rank 16."""
    clusters = min(CLUSTERS, side)
    return with_components(planted_model(side, LOBES, clusters, CLUSTER_LOBES), rank=RANK)
