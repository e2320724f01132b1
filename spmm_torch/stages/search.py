"""Stage search: lobes that fit the samples, by the method that the settings name."""

from __future__ import annotations

import torch
from torch import Tensor

from ..config import FitConfig
from ..data import BTF
from ..lobe import Feasible, decode
from .bank import build_bank
from .corrective import Advance, CorrectiveSearch, Mixtures
from .dictionary import FoundLobes
from .grid import DirectionGrid
from .stagewise import StagewiseSearch


def search_steps(config: FitConfig, samples: int) -> int:
    """How many units the search of so many samples advances by."""
    if config.search.method == "stagewise":
        return samples
    return samples * (config.search.max_lobes + config.search.exchanges)


def search_lobes(
    btf: BTF,
    texels: Tensor,
    clusters: Tensor,
    grid: DirectionGrid,
    config: FitConfig,
    generator: torch.Generator,
    advance: Advance,
) -> FoundLobes:
    """Finds the lobes of sampled `texels [S]` of `clusters [S]` [WDR11 §3.2].

    Where texels may have fewer lobes than samples, samples get that few too: their lobes must
    do the work alone.
    """
    search = config.search
    feasible = Feasible.build(search.min_width * grid.spacing)
    bank = build_bank(grid, search.models, search.bank_normals, feasible)
    signals = btf.texels(texels, grid.light.device).transpose(1, 2).contiguous()  # [S, C, D]
    if search.method == "stagewise":
        finder = StagewiseSearch.build(
            grid, bank, feasible, search, config.stagewise, signals, generator
        )
        mixtures = finder.run(advance)
    else:
        energy = (signals * signals).sum((1, 2), dtype=torch.float64)
        mixtures = CorrectiveSearch(grid, bank, feasible, search, signals, energy).run(advance)
    return _found(mixtures, clusters, grid)


def _found(mixtures: Mixtures, clusters: Tensor, grid: DirectionGrid) -> FoundLobes:
    """All lobes that carry weight, with the share of energy that each stands for."""
    used = mixtures.present & (mixtures.weights > 0.0).any(2)  # [S, M]
    host = used.cpu()
    lobes = decode(mixtures.model[host], mixtures.coordinates[used])
    owner = clusters[:, None].expand(host.shape)[host]
    share = mixtures.weights[used].square().sum(1)
    share = share * grid.eval(lobes).square().sum(1)
    return FoundLobes(lobes, owner, share.cpu())
