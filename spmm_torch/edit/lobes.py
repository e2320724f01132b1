"""Edits of the lobes themselves: the dictionary is shared by texels, so masks split its lobes."""

from __future__ import annotations

from torch import Tensor

from ..lobes.batch import LobeBatch
from ..model.spmm import SPMM, SparseWeights
from .energy import energy_factors
from .parts import from_entries, scaled_entries, with_parts
from .selection import Selection


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
    scale = share if factor is None else share * factor[model.index]
    parts = (scaled_entries(model, 1.0 - share), scaled_entries(model, scale, len(before)))
    return from_entries(model, LobeBatch.cat((before, lobes)), parts)


def differing(before: LobeBatch, after: LobeBatch) -> Tensor:
    """Which of J lobes are not the same to the bit, `[J]`."""
    differs = (before.model != after.model).to(before.kappa.device)
    for part in ("kappa", "normal", "angle"):
        pair = getattr(before, part), getattr(after, part)
        differs = differs | (pair[0] != pair[1]).view(len(before), -1).any(1)
    return differs
