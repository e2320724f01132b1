"""Edits of the lobes themselves: the dictionary is shared by texels, so masks split its lobes."""

from __future__ import annotations

import torch
from torch import Tensor

from ..lobe import LobeBatch
from ..lobe_sampling import LobeTable, lobe_intensity
from ..model import SPMM, SparseWeights
from .parts import entry_texels, from_entries, with_parts
from .selection import Selection

# Directions that average a lobe: as they are the same before and after, errors mostly cancel.
ENERGY_SAMPLES = 256


def with_lobes(
    model: SPMM, lobes: LobeBatch, where: Selection | None = None, keep_energy: bool = False
) -> SPMM:
    """The model with its J lobes replaced by others, where it is selected.

    Without selection the dictionary is replaced, entries stay as they are. With one, an entry of
    share m and weight alpha becomes an edited one of weight m * alpha and an unedited one of
    (1 - m) * alpha; those of weight 0 are left out. The dictionary grows only by lobes that are
    used edited and unedited. The residual is kept.

    Args:
        lobes: one for each lobe of the dictionary; unchanged ones are never split.
        where: None for the whole texture.
        keep_energy: weights are scaled so that every lobe reflects as much as before, averaged
            over all lights and views.
    """
    before = model.dictionary.detach()
    changed = differing(before, lobes)  # [J]
    if not bool(changed.any()):
        return model
    factor = energy_factors(before, lobes, changed) if keep_energy else None
    if where is None:
        weights = model.sparse_weights
        if factor is not None:
            weight = model.weight * factor[model.index][:, None]
            weights = SparseWeights(model.offset, model.index, weight)
        return with_parts(model, lobes=lobes, weights=weights)
    share = where.entries * changed[model.index]  # [N]
    if not bool((share > 0.0).any()):
        return model
    kept, taken = (torch.nonzero(part).squeeze(-1) for part in (share < 1.0, share > 0.0))
    texel, index, weight = entry_texels(model), model.index, model.weight
    scale = share if factor is None else share * factor[index]
    entries = (
        torch.cat((texel[kept], texel[taken])),
        torch.cat((index[kept], index[taken] + len(before))),
        torch.cat((weight[kept] * (1.0 - share)[kept, None], weight[taken] * scale[taken, None])),
    )
    return from_entries(model, LobeBatch.cat((before, lobes)), entries)


def differing(before: LobeBatch, after: LobeBatch) -> Tensor:
    """Which of J lobes are not the same to the bit, `[J]`."""
    differs = (before.model != after.model).to(before.kappa.device)
    for part in ("kappa", "normal", "angle"):
        pair = getattr(before, part), getattr(after, part)
        differs = differs | (pair[0] != pair[1]).view(len(before), -1).any(1)
    return differs


def energy_factors(before: LobeBatch, after: LobeBatch, changed: Tensor) -> Tensor:
    """What weights are multiplied by, `[J]`, so that each lobe keeps its mean over all lights and
    views; 1 where the lobe has not changed."""
    rows = torch.nonzero(changed).squeeze(-1)
    means = [mean_reflection(lobes[rows]) for lobes in (before, after)]
    lit = (means[0] > 0.0) & (means[1] > 0.0)
    ratio = torch.where(lit, means[0] / torch.where(lit, means[1], 1.0), 1.0)
    return torch.ones_like(before.angle).index_copy(0, rows, ratio)


def mean_reflection(lobes: LobeBatch) -> Tensor:
    """The mean of rho_j over light and view, `[J]`."""
    return lobe_intensity(lobes, LobeTable.build(lobes), ENERGY_SAMPLES)
