"""Lobes replaced where they are selected: texels share the dictionary, so a mask splits lobes."""

from __future__ import annotations

from dataclasses import replace

import torch
from torch import Tensor

from ..lobes.batch import LobeBatch
from ..model.lookup import SparseWeights
from ..model.spmm import SPMM
from .energy import energy_factors
from .entries import from_entries, scaled_entries
from .parts import with_parts
from .selection import EVERYTHING, Selection


def with_lobes(
    model: SPMM, lobes: LobeBatch, where: Selection = EVERYTHING, keep_energy: bool = False
) -> SPMM:
    """The model with its lobes replaced by others where they are selected; the residual is kept.

    Without a mask the dictionary is replaced, and entries stay. With one, an entry of share m and
    weight alpha becomes an edited one of weight m * alpha and an unedited one of (1 - m) * alpha;
    entries of weight 0 are left out. The dictionary grows only by lobes that are used both edited
    and unedited.

    Args:
        model: the original, with J lobes.
        lobes: one in place of each of the J lobes; an equal one is never split.
        where: lobes outside of its group stay.
        keep_energy: whether weights are scaled so that each lobe reflects as much as before,
            averaged over all lights and views.
    """
    before = model.dictionary.detach()
    if where.lobes is not None:
        lobes = _chosen(where.lobes, lobes, before)
    changed = differing(before, lobes)  # [J]
    if not bool(changed.any()):
        return model
    factor = energy_factors(before, lobes, changed) if keep_energy else None
    if where.entries is None:
        weights = model.sparse_weights
        if factor is not None:
            weight = model.weight * factor[model.index][:, None]
            weights = SparseWeights(model.offset, model.index, weight)
        return with_parts(model, lobes=lobes, weights=weights)
    share = where.entries * changed[model.index]  # [N]
    if not bool((share > 0.0).any()):
        return model
    scale = share if factor is None else share * factor[model.index]
    parts = (scaled_entries(model, 1.0 - share), scaled_entries(model, scale, len(before)))
    return from_entries(model, LobeBatch.cat((before, lobes)), parts)


def differing(before: LobeBatch, after: LobeBatch) -> Tensor:
    """True for each of J lobes that is not the same to the bit, `[J]`."""
    differs = before.model != after.model
    for part in ("kappa", "normal", "angle"):
        pair = getattr(before, part), getattr(after, part)
        differs = differs | (pair[0] != pair[1]).view(len(before), -1).any(1)
    return differs


def _chosen(mask: Tensor, first: LobeBatch, second: LobeBatch) -> LobeBatch:
    """The lobes of `first` where `mask [J]` is true, else those of `second`."""
    return replace(
        second,
        model=torch.where(mask, first.model, second.model),
        kappa=torch.where(mask[:, None], first.kappa, second.kappa),
        normal=torch.where(mask[:, None], first.normal, second.normal),
        angle=torch.where(mask, first.angle, second.angle),
    )
