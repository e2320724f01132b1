"""Stage search: the lobes that fit the samples, found by the method of the settings."""

from __future__ import annotations

import torch
from torch import Tensor

from ...config.fit import FitConfig, SearchConfig
from ...lobes.batch import Feasible, LobeBatch
from ...runtime.progress import Advance
from ...solvers.multistart import StartCounts
from ..cluster import Samples
from ..dictionary import FoundLobes
from ..glossy.centre import centred
from ..glossy.energy import held_to_energy
from ..problem import Problem
from .bank import build_bank, narrow_bank
from .exact import ExactErrors
from .joint import FEW_ROWS, CorrectiveSearch
from .mixtures import Mixtures
from .music import music_lobes
from .stagewise import StagewiseSearch

# Normals of the bank where the settings do not tell: few samples afford a finer bank.
FINE_NORMALS, COARSE_NORMALS = 120, 64
# Factor of the least width where samples are exact sums of few lobes. Elsewhere a lobe that narrow,
# between measured half vectors, is known by its tails alone and its peak is made up.
EXACT_WIDTH = 0.5


def search_steps(config: FitConfig, samples: int) -> int:
    """Progress units of the search on so many samples."""
    if config.search.method == "stagewise":
        return samples
    return samples * (config.search.max_lobes + config.search.exchanges)


def bank_normals(config: SearchConfig, samples: int) -> int:
    """Normals of the bank for so many samples."""
    if config.bank_normals is not None:
        return config.bank_normals
    return FINE_NORMALS if samples <= FEW_ROWS else COARSE_NORMALS


def search_lobes(problem: Problem, samples: Samples) -> FoundLobes:
    """The lobes of the samples [WDR11 §3.2, Eq. 5], searched by the first rank for all."""
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
        advance: receives `search_steps` units in all.
    """
    search, grid = problem.config.search, problem.grid()
    signals = problem.signals(samples.texels)  # [S, C, D]
    width = search.min_width * grid.spacing
    peak, models = problem.objective.peak, problem.objective.models(search.models)
    feasible, fine = (Feasible.build(w).to(grid.light) for w in (width, EXACT_WIDTH * width))
    bank = build_bank(grid, models, bank_normals(search, len(samples)), feasible)
    if peak is not None:
        feasible = feasible.or_as_narrow_as(peak.width)
        bank = bank.joined(narrow_bank(grid, models, peak.width, feasible))
    finder: StagewiseSearch | CorrectiveSearch
    if search.method == "stagewise":
        finder = StagewiseSearch.build(
            grid, bank, feasible, search, problem.config.stagewise, signals, generator
        )
    else:
        known = music_lobes(signals.flatten(0, 1), grid, bank, fine)
        bounds = fine if len(known) else feasible
        exact = _exact(problem, samples)
        finder = CorrectiveSearch(grid, bank, bounds, search, signals, known, exact=exact)
    mixtures = finder.run(advance)
    if peak is None:
        used = _used(mixtures)
        lobes = grid.decode(mixtures.model[used], mixtures.coordinates[used])
    else:
        lobes = grid.decode(mixtures.model.flatten(), mixtures.coordinates.flatten(0, 1))
        weights = mixtures.weights * mixtures.present[..., None]
        lobes, weights = centred(lobes, weights.flatten(0, 1), grid, width)
        weights = weights.view(*mixtures.weights.shape)
        lobes = held_to_energy(lobes, weights, peak, width)[_used(mixtures).flatten()]
    return _found(lobes, mixtures, samples.clusters, signals, finder.counts)


def _exact(problem: Problem, samples: Samples) -> ExactErrors | None:
    """Errors of samples in the measure of the objective; None where these are plain squares."""
    pair = problem.weights.pair
    if problem.compression is None or pair is None:
        return None
    values = problem.btf.signals(samples.texels, problem.device)
    return ExactErrors.of(problem.grid(), problem.compression, values, pair)


def _used(mixtures: Mixtures) -> Tensor:
    """True `[S, M]` for lobes with a weight above 0."""
    return mixtures.present & (mixtures.weights > 0.0).any(2)


def _found(
    lobes: LobeBatch,
    mixtures: Mixtures,
    clusters: Tensor,
    signals: Tensor,
    counts: StartCounts,
) -> FoundLobes:
    """The lobes with a weight above 0, and the relative error of the sample of each."""
    host = _used(mixtures).cpu()
    energy = (signals * signals).sum((1, 2), dtype=torch.float64)
    error = mixtures.loss / energy.clamp(min=torch.finfo(energy.dtype).tiny)
    cluster, error = (x.cpu()[:, None].expand(host.shape)[host] for x in (clusters, error))
    return FoundLobes(lobes, cluster, error, counts.to_tensor(), counts.solvers)
