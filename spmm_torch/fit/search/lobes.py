"""Stage search: the lobes that fit the samples, found by the method of the settings."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from ...config.fit import FitConfig, SearchConfig
from ...lobes.batch import Feasible, LobeBatch
from ...lobes.grid import DirectionGrid
from ...runtime.progress import Advance
from ...solvers.multistart import StartCounts
from ..cluster import Samples
from ..dictionary import FoundLobes
from ..glossy.objective import LONG_TAILED
from ..problem import Problem
from .bank import Bank, build_bank, narrow_bank
from .exact import ExactErrors, held
from .joint import FEW_ROWS, CorrectiveSearch
from .mixtures import Mixtures
from .music import music_lobes
from .stagewise import PATH_UNITS, StagewiseSearch

# Normals of the bank where the settings do not tell: few samples afford a finer bank.
FINE_NORMALS, COARSE_NORMALS = 120, 64
# Factor of the least width where samples are exact sums of few lobes. Elsewhere a lobe that narrow,
# between measured half vectors, is known by its tails alone and its peak is made up.
EXACT_WIDTH = 0.5


def search_steps(config: FitConfig, samples: int) -> int:
    """Progress units of the search on so many samples."""
    if config.search.method == "stagewise":
        return samples * PATH_UNITS
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
    peak, width = problem.objective.peak, search.min_width * grid.spacing
    scene = _Scene(problem, grid, signals, Feasible.build(width).to(grid.light))
    energy = (signals * signals).sum((1, 2), dtype=torch.float64)
    if search.method == "stagewise":
        mixtures, counts = _stagewise(scene, generator, advance)
    else:
        exact = _exact(scene, samples)
        mixtures, counts = _corrective(scene, exact, advance)
        energy = energy if exact is None else exact.energy
    used = _used(mixtures)
    if peak is None:
        lobes = grid.decode(mixtures.model[used], mixtures.coordinates[used])
    else:
        lobes = held(mixtures, grid, peak, width)[used.flatten()]
    return _found(lobes, mixtures, samples.clusters, energy, counts)


@dataclass(frozen=True)
class _Scene:
    """What all starts of a search share."""

    problem: Problem
    grid: DirectionGrid
    signals: Tensor  # [S, C, D]
    feasible: Feasible  # of lobes that the pairs resolve

    @property
    def models(self) -> tuple[str, ...]:
        """Models of the lobes."""
        btf, config = self.problem.btf, self.problem.config
        each = btf.names is not None or btf.texel_count <= FEW_ROWS
        return self.problem.objective.models(config.search.models, each)

    def bank(self, models: tuple[str, ...]) -> Bank:
        """Candidates that the pairs resolve."""
        count = bank_normals(self.problem.config.search, len(self.signals))
        return build_bank(self.grid, models, count, self.feasible)

    def narrow(
        self, bank: Bank, bounds: Feasible, models: tuple[str, ...]
    ) -> tuple[Bank, Feasible]:
        """Candidates and bounds with which some models may be as narrow as unresolved peaks."""
        peak = self.problem.objective.peak
        if peak is None:
            return bank, bounds
        bounds = bounds.or_as_narrow_as(peak.width, models)
        return bank.joined(narrow_bank(self.grid, models, peak.width, bounds)), bounds


def _stagewise(
    scene: _Scene, generator: torch.Generator, advance: Advance
) -> tuple[Mixtures, StartCounts]:
    """The paper's search."""
    config = scene.problem.config
    bank, bounds = scene.narrow(scene.bank(scene.models), scene.feasible, scene.models)
    finder = StagewiseSearch.build(
        scene.grid, bank, bounds, config.search, config.stagewise, scene.signals, generator
    )
    return finder.run(advance), finder.counts


def _corrective(
    scene: _Scene, exact: ExactErrors | None, advance: Advance
) -> tuple[Mixtures, StartCounts]:
    """The default search; of several starts each sample keeps the best."""
    search, starts = scene.problem.config.search, _starts(scene)
    fine = Feasible.build(EXACT_WIDTH * search.min_width * scene.grid.spacing).to(scene.grid.light)
    bank = scene.bank(starts[0].models)
    known = music_lobes(scene.signals.flatten(0, 1), scene.grid, bank, fine)
    if len(known) and not scene.problem.objective.unresolved:
        starts = starts[:1]  # few lobes of the first make all signals
    bounds = fine if len(known) else scene.feasible
    counts = StartCounts()
    advance = _in_parts(advance, len(starts))
    best: Mixtures | None = None
    for start in starts:
        more = tuple(name for name in start.models if name not in starts[0].models)
        whole = bank.joined(scene.bank(more)) if more else bank
        own = scene.narrow(whole, bounds, start.narrow)
        finder = CorrectiveSearch(
            scene.grid, *own, search, scene.signals, known, counts=counts, exact=exact
        )
        found = finder.run(advance)
        best = found if best is None else best.better(found)
    assert best is not None
    return best, counts


@dataclass(frozen=True)
class _Start:
    """Models of the lobes of one search, and those of them that may be as narrow as a peak."""

    models: tuple[str, ...]
    narrow: tuple[str, ...]


def _starts(scene: _Scene) -> list[_Start]:
    """The searches of all samples: where each can afford it, with and without long tails.

    Samples hardly tell whether a peak has a long tail, but which lobe is chosen first decides where
    a search ends.
    """
    models, given = scene.models, scene.problem.config.search.models
    every = _Start(models, models)
    if not scene.problem.objective.unresolved:
        return [every] if models == given else [_Start(given, given), every]
    short = tuple(name for name in models if name != LONG_TAILED)
    again = models != short and len(scene.signals) <= FEW_ROWS
    return [every, _Start(models, short)] if again else [every]


def _in_parts(advance: Advance, parts: int) -> Advance:
    """What counts the steps of so many searches as those of one."""
    left = 0

    def some(steps: int) -> None:
        nonlocal left
        left += steps
        advance(left // parts)
        left %= parts

    return advance if parts == 1 else some


def _exact(scene: _Scene, samples: Samples) -> ExactErrors | None:
    """Errors in the measure of the objective; None where squared ones have a part in it.

    Weighted squared errors of resolved peaks hold what lies between samples better.
    """
    problem = scene.problem
    compression, pair = problem.compression, problem.weights.pair
    if compression is None or compression.plain > 0.0 or pair is None:
        return None
    values = problem.btf.signals(samples.texels, problem.device)
    resolved = problem.config.search.min_width * scene.grid.spacing
    return ExactErrors.of(scene.grid, compression, values, pair, problem.objective.peak, resolved)


def _used(mixtures: Mixtures) -> Tensor:
    """True `[S, M]` for lobes with a weight above 0."""
    return mixtures.present & (mixtures.weights > 0.0).any(2)


def _found(
    lobes: LobeBatch,
    mixtures: Mixtures,
    clusters: Tensor,
    energy: Tensor,
    counts: StartCounts,
) -> FoundLobes:
    """The lobes with a weight above 0, and the relative error of the sample of each.

    Samples have an error of `energy [S]` without any lobe.
    """
    host = _used(mixtures).cpu()
    error = mixtures.loss / energy.clamp(min=torch.finfo(energy.dtype).tiny)
    cluster, error = (x.cpu()[:, None].expand(host.shape)[host] for x in (clusters, error))
    return FoundLobes(lobes, cluster, error, counts.to_tensor(), counts.solvers)
