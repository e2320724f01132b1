"""Stage search: lobes that fit the samples, by the method that the settings name."""

from __future__ import annotations

import torch
from torch import Tensor

from ...config.fit import FitConfig, SearchConfig
from ...lobes.batch import Feasible, decode
from ...runtime.progress import Advance
from ...solvers.multistart import StartTally
from ..cluster import Samples
from ..dictionary import FoundLobes
from ..problem import Problem
from .bank import build_bank
from .joint import FEW_ROWS, CorrectiveSearch
from .mixtures import Mixtures
from .music import spanned_lobes
from .stagewise import StagewiseSearch

# Normals of the bank where the settings leave them open: few samples can afford a finer one.
FINE_NORMALS, COARSE_NORMALS = 120, 64
# Share of the least width down to which lobes may go where samples are exact sums of few lobes.
# Anywhere else a lobe narrower than the gaps between measured half vectors, a quarter of the angle
# between directions, is seen by its tails alone, and its peak between the samples is made up.
EXACT_WIDTH = 0.5


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


def search_lobes(problem: Problem, samples: Samples) -> FoundLobes:
    """The lobes of the samples [WDR11 §3.2, Eq. 5]; one rank searches for all."""
    context = problem.context

    def search(advance: Advance) -> FoundLobes:
        generator = context.generator("search")
        return context.ranks.first(
            lambda: find_lobes(problem, samples, generator, advance).on_cpu()
        )

    steps = search_steps(problem.config, len(samples))
    return context.stage("search", FoundLobes, search, steps, "steps")


def find_lobes(
    problem: Problem, samples: Samples, generator: torch.Generator, advance: Advance
) -> FoundLobes:
    """The lobes of the samples, searched in this process.

    Args:
        problem: the fit.
        samples: S texels.
        generator: draws direction pairs (stagewise).
        advance: told `search_steps` units in all.
    """
    search, grid = problem.config.search, problem.grid()
    feasible = Feasible.build(search.min_width * grid.spacing)
    bank = build_bank(grid, search.models, bank_normals(search, len(samples)), feasible)
    fine = Feasible.build(EXACT_WIDTH * search.min_width * grid.spacing)
    signals = problem.signals(samples.texels)  # [S, C, D]
    finder: StagewiseSearch | CorrectiveSearch
    if search.method == "stagewise":
        finder = StagewiseSearch.build(
            grid, bank, feasible, search, problem.config.stagewise, signals, generator
        )
    else:
        known = spanned_lobes(signals.flatten(0, 1), grid, bank, fine)
        bounds = fine if len(known) else feasible
        finder = CorrectiveSearch(grid, bank, bounds, search, signals, known)
    mixtures = finder.run(advance)
    return _found(mixtures, samples.clusters, signals, finder.tally)


def _found(mixtures: Mixtures, clusters: Tensor, signals: Tensor, tally: StartTally) -> FoundLobes:
    """All lobes that carry weight, and how well the sample of each is fit."""
    used = mixtures.present & (mixtures.weights > 0.0).any(2)  # [S, M]
    host = used.cpu()
    lobes = decode(mixtures.model[used], mixtures.coordinates[used])
    energy = (signals * signals).sum((1, 2), dtype=torch.float64)
    error = mixtures.loss / energy.clamp(min=torch.finfo(energy.dtype).tiny)
    cluster, error = (x.cpu()[:, None].expand(host.shape)[host] for x in (clusters, error))
    return FoundLobes(lobes, cluster, error, tally.to_tensor(), tally.solvers)
