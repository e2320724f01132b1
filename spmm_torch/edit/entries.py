"""Entries of a model: a lobe in a texel with its weight; scaled, and put together anew."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from ..lobes.batch import LobeBatch
from ..model.components import Components
from ..model.lookup import SparseWeights
from ..model.residual import Residual
from ..model.spmm import SPMM
from .parts import with_parts


@dataclass(frozen=True)
class Entries:
    """n entries in the order of their texels.

    Attributes:
        texel: ascending, `[n]`.
        lobe: index into a dictionary, `[n]`.
        weight: `[n, C]`.
    """

    texel: Tensor
    lobe: Tensor
    weight: Tensor


def entry_texels(model: SPMM) -> Tensor:
    """The texel of each entry, `[N]`."""
    return torch.repeat_interleave(model.lobe_count_per_texel())


def scaled_entries(model: SPMM, share: Tensor, first_lobe: int = 0) -> Entries:
    """The entries of a model with their weights times `share [N]`, without those of share 0.

    Args:
        model: whose entries are scaled.
        share: factor on the weight of each entry, `[N]`.
        first_lobe: place of the model's first lobe in the dictionary that the result refers to.
    """
    texel, lobe = entry_texels(model), model.index + first_lobe
    weight = model.weight * share[:, None]
    if bool((share > 0.0).all()):
        return Entries(texel, lobe, weight)
    kept = torch.nonzero(share > 0.0).squeeze(-1)
    return Entries(*(part.index_select(0, kept) for part in (texel, lobe, weight)))


def from_entries(
    model: SPMM,
    lobes: LobeBatch,
    parts: Sequence[Entries],
    labels: Tensor | None = None,
    residual: Residual | None = None,
    components: Components | None = None,
) -> SPMM:
    """A model of the same size with other entries; lobes that no entry uses are left out.

    Args:
        model: gives the size, and what of the residual is not given.
        lobes: a dictionary of J lobes.
        parts: entries by texel; those of one texel keep the order of the parts. Each part is in
            order already, so counting merges them.
        labels: cluster of each texel, `[T]`.
        residual: epsilon of each cluster.
        components: the residual of each texel.
    """
    counts = [torch.bincount(part.texel, minlength=model.texel_count) for part in parts]
    total = torch.stack(counts).sum(0)  # [T]
    offset = torch.cat((total.new_zeros(1), total.cumsum(0)))
    index = total.new_empty(sum(len(part.texel) for part in parts))
    weight = model.weight.new_empty(len(index), model.weight.shape[1])
    start = offset[:-1]  # [T], place of each texel's first entry of the next part
    for part, count in zip(parts, counts, strict=True):
        shift = start - (count.cumsum(0) - count)
        number = torch.arange(len(part.texel), device=index.device)
        place = number + shift.index_select(0, part.texel)
        index.index_copy_(0, place, part.lobe)
        weight.index_copy_(0, place, part.weight)
        start = start + count
    used = torch.bincount(index, minlength=len(lobes)) > 0  # [J]
    position = used.cumsum(0) - 1
    weights = SparseWeights(offset, position.index_select(0, index), weight)
    return with_parts(
        model,
        lobes=lobes[used],
        weights=weights,
        labels=labels,
        residual=residual,
        components=components,
    )
