"""Stage dictionary: the union of all lobes found on the samples, without repeats [WDR11 §4.1]."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from ..config import DictionaryConfig
from ..lobe import LobeBatch
from .grid import DirectionGrid


@dataclass(frozen=True)
class FoundLobes:
    """What a search found.

    Attributes:
        lobes: N lobes.
        cluster: cluster of the sample that each was found on, `[N]` on the CPU.
        share: how much of its sample's energy each explains, `[N]` on the CPU; ranks repeats.
    """

    lobes: LobeBatch
    cluster: Tensor
    share: Tensor


@dataclass(frozen=True)
class Dictionary:
    """The lobes that texels may choose from.

    Attributes:
        lobes: J lobes.
        atoms: their values on all pairs, each of unit norm, `[J, D]`.
        norm: norms of the values before that, `[J]`.
        choices: for each cluster, the indices of the lobes open to it, on the CPU.
    """

    lobes: LobeBatch
    atoms: Tensor
    norm: Tensor
    choices: list[Tensor]


def build_dictionary(
    found: FoundLobes, cluster_count: int, grid: DirectionGrid, config: DictionaryConfig
) -> Dictionary:
    """Merges lobes whose correlation is above `config.merge`; the one that explains more stays."""
    values = grid.eval(found.lobes)
    norm = values.norm(dim=1)
    visible = torch.nonzero(norm > 0.0).squeeze(1)
    rank = found.share[visible.cpu()].argsort(descending=True, stable=True)
    order = visible[rank.to(visible.device)]
    atoms = values[order] / norm[order, None]
    owner = found.cluster[order.cpu()]
    if config.scope == "shared":
        kept = _distinct(atoms, config.merge)
        choices = [torch.arange(len(kept))] * cluster_count
    else:
        groups = [torch.nonzero(owner == k).squeeze(1) for k in range(cluster_count)]
        groups = [group[_distinct(atoms[group.to(atoms.device)], config.merge)] for group in groups]
        kept = torch.cat(groups)
        choices = list(torch.arange(len(kept)).split([len(group) for group in groups]))
    where = kept.to(atoms.device)
    return Dictionary(found.lobes[order][where], atoms[where], norm[order][where], choices)


def _distinct(atoms: Tensor, limit: float) -> Tensor:
    """Indices on the CPU of atoms `[J, D]` that no earlier kept one resembles, in their order."""
    alike = (atoms @ atoms.T > limit).cpu().triu(1)
    kept = torch.ones(len(atoms), dtype=torch.bool)
    for row in range(len(atoms)):
        if kept[row]:
            kept &= ~alike[row]
    return torch.nonzero(kept).squeeze(1)
