"""Stage search: lobes that fit the samples, by the method that the settings name."""

from __future__ import annotations

import torch
from torch import Tensor

from ..config import FitConfig, SearchConfig
from ..data import BTF
from ..lobe import Feasible, decode
from .bank import build_bank
from .corrective import FEW_ROWS, Advance, CorrectiveSearch, Mixtures
from .dictionary import FoundLobes
from .grid import DirectionGrid
from .stagewise import StagewiseSearch

# Normals of the bank where the settings leave them open: few samples can afford a finer one.
FINE_NORMALS, COARSE_NORMALS = 120, 64


def search_steps(config: FitConfig, samples: int) -> int:
    """How many units the search of so many samples advances by."""
    if config.search.method == "stagewise":
        return samples
    return samples * (config.search.max_lobes + config.search.exchanges)


def bank_normals(config: SearchConfig, samples: int) -> int:
    """How many normals the bank has for so many samples."""
    if config.bank_normals is not None:
        return config.bank_normals
    return FINE_NORMALS if samples <= FEW_ROWS else COARSE_NORMALS


def search_lobes(
    btf: BTF,
    texels: Tensor,
    clusters: Tensor,
    grid: DirectionGrid,
    config: FitConfig,
    generator: torch.Generator,
    advance: Advance,
) -> FoundLobes:
    """Finds the lobes of sampled `texels [S]` of `clusters [S]` [WDR11 §3.2]."""
    search = config.search
    feasible = Feasible.build(search.min_width * grid.spacing)
    bank = build_bank(grid, search.models, bank_normals(search, len(texels)), feasible)
    signals = btf.texels(texels, grid.light.device).transpose(1, 2).contiguous()  # [S, C, D]
    if search.method == "stagewise":
        finder = StagewiseSearch.build(
            grid, bank, feasible, search, config.stagewise, signals, generator
        )
    else:
        finder = CorrectiveSearch(grid, bank, feasible, search, signals)
    mixtures = finder.run(advance)
    return _found(mixtures, clusters, signals, finder.tally.to_tensor())


def _found(mixtures: Mixtures, clusters: Tensor, signals: Tensor, starts: Tensor) -> FoundLobes:
    """All lobes that carry weight, and how well the sample of each is fit."""
    used = mixtures.present & (mixtures.weights > 0.0).any(2)  # [S, M]
    host = used.cpu()
    lobes = decode(mixtures.model[host], mixtures.coordinates[used])
    energy = (signals * signals).sum((1, 2), dtype=torch.float64)
    error = mixtures.loss / energy.clamp(min=torch.finfo(energy.dtype).tiny)
    wide = [column.cpu()[:, None].expand(host.shape)[host] for column in (clusters, error)]
    return FoundLobes(lobes, *wide, starts)
