"""Stage refit: weights and residual fit to the measured pictures, through the relief.

Lobes are chosen on aligned values, which is cheap. Alignment resamples every picture, though, and
what it blurs is lost. Here the weights of the same lobes are fit to the pictures themselves, and so
is the residual; errors are exact and of the pictures too.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import torch
from torch import Tensor

from ...lobes.batch import LobeBatch
from ...metrics import Totals
from ...model.lookup import SparseWeights
from ...model.stored_weights import by_lobe
from ...runtime.allocator import give_back_freed_memory
from ...solvers.status import StatusCounts
from ..cluster import Clusters
from ..mixtures import Mixtures
from ..problem import Problem
from ..select.clusters import ClusterFit
from .rank_residual import RankResidual
from .setup import Advance, Setup
from .storage import Storage
from .system import ROUNDING, System
from .turns import Turns


@dataclass(frozen=True)
class Refit:
    """What the refit gives.

    Attributes:
        entries: lobes of all texels and their weights, as stored.
        weight_type: number type of the stored weights.
        totals: squared errors over all measured values.
        weighted: the same with the weights of the values; None where these are all 1.
        solvers: problems solved, by solver and status.
        components: residual of rank R; None for none.
        clusters: residuals as codes `[K, V, L, C]` and scales `[K]`; None for none.
    """

    entries: SparseWeights
    weight_type: torch.dtype
    totals: Totals
    weighted: Totals | None
    solvers: StatusCounts
    components: RankResidual | None = None
    clusters: tuple[Tensor, Tensor] | None = None


def refit_pictures(
    problem: Problem, clusters: Clusters, found: Mixtures, fits: list[ClusterFit]
) -> Refit:
    """Fits weights and residual to the pictures, where that can be better than what `fits` say.

    Args:
        problem: of the fit.
        clusters: of the texels.
        found: lobes, chosen on aligned values, and first weights.
        fits: of the clusters, with their residuals and errors.
    """
    config = problem.config
    flat = problem.relief is None and config.residual.rank == 0
    if flat and config.storage.weights == "float32":
        return _as_found(problem, found, fits)
    lobes = found.lobes.to(problem.device)
    entries = by_lobe(SparseWeights(*(x.to(problem.device) for x in vars(found.entries).values())))
    total = _passes(problem) * len(problem.btf.view)
    by_clusters = _totals(fits).with_residual if config.residual.clusters else None
    with problem.context.progress.stage("pictures", total, "views") as advance:
        return _refit(problem, clusters, lobes, entries, by_clusters, advance)


def _passes(problem: Problem) -> int:
    """How often the pictures are read."""
    residual = problem.config.residual
    sweeps = problem.config.refit.sweeps + problem.objective.unresolved if residual.rank else 0
    plain = 1 + (residual.rank > 0 or residual.clusters)  # errors without weights
    return 1 + sweeps + residual.clusters + (0 if problem.weights.uniform else plain)


def _as_found(problem: Problem, found: Mixtures, fits: list[ClusterFit]) -> Refit:
    """The fits of the clusters as they are."""
    weighted = [fit.weighted for fit in fits if fit.weighted is not None]
    shape = (len(problem.btf.view), len(problem.btf.light))
    return Refit(
        found.entries,
        torch.float32,
        Totals.sum(fit.totals for fit in fits),
        Totals.sum(weighted) if weighted else None,
        StatusCounts.none(),
        clusters=(
            torch.stack([fit.code.unflatten(0, shape) for fit in fits]),
            torch.stack([fit.scale for fit in fits]),
        ),
    )


def _refit(
    problem: Problem,
    clusters: Clusters,
    lobes: LobeBatch,
    entries: SparseWeights,
    by_clusters: float | None,
    advance: Advance,
) -> Refit:
    """`refit_pictures` by some passes over the pictures."""
    context, config = problem.context, problem.config
    uniform = problem.weights.uniform
    setup = Setup(problem, lobes, clusters.labels, advance)
    with context.watch("refit"):
        system = setup.system(entries)
        entries, solvers = _weights(system, entries, config.refit.steps)
    turns = Turns.start(setup, system, clusters, entries) if config.residual.rank else None
    if turns is not None:
        for number in range(config.refit.sweeps):
            turns = turns.next(number)
        if problem.objective.unresolved:
            turns = turns.trusted(config.refit.sweeps)
    with context.watch("refit"):
        give_back_freed_memory()
        entries = turns.entries if turns else entries
        storage = Storage(system, entries, turns, by_clusters, context.generator("rounding"))
        stored = storage.chosen(config.storage.weights)
        entries = stored.entries
    components, own, taken = None, None, 0.0
    if stored.turns is not None:
        with context.watch("residual"):
            components = stored.turns.stored()
            taken = components.taken
    if config.residual.clusters:
        with context.watch("residual"):
            own, taken = setup.clusters(entries, components, system)
    weighted = totals = system.totals(entries.weight, taken)
    if min(totals.without_residual, totals.with_residual) < ROUNDING * totals.energy:
        with context.watch("evaluate"):
            exact = replace(setup, advance=lambda views: None)  # a pass that none could foresee
            weighted = totals = exact.totals(entries, components, own, system.lookups, setup.scale)
    if not uniform:
        with context.watch("evaluate"):
            totals = setup.plain_totals(entries, components, own)
    by_weight = None if uniform else weighted
    return Refit(entries, stored.kind, totals, by_weight, solvers, components, own)


def _totals(fits: list[ClusterFit]) -> Totals:
    """Squared errors of all clusters by weight, on aligned values."""
    return Totals.sum(fit.weighted or fit.totals for fit in fits)


def _weights(
    system: System, entries: SparseWeights, steps: int
) -> tuple[SparseWeights, StatusCounts]:
    """The weights of least error, and how their solver ended."""
    if not system.lookups.mixed:  # each texel is alone, and its weights are best already
        return entries, StatusCounts.none()
    return system.fitted(entries, system.products.lobes, steps)
