"""Stage refit: weights and residual fit to the measured pictures, through the relief.

Lobes are chosen on aligned values, which is cheap. Alignment resamples every picture, though, and
what it blurs is lost. Here the weights of the same lobes are fit to the pictures themselves, and so
is the residual; errors are exact and of the pictures too.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from ...data.error_weights import UNIFORM, Weights
from ...lobes.batch import LobeBatch
from ...metrics import Totals, snr_db
from ...model.components import decode_coefficients, encode_coefficients, encode_functions
from ...model.lookup import SparseWeights
from ...model.residual import decode_residual, encode_residual
from ...model.stored_weights import WEIGHT_TYPES, by_lobe, rounded
from ...solvers.sparse_nnls import sparse_nnls
from ...solvers.status import Solver, StatusCounts
from ..cluster import Clusters
from ..mixtures import Mixtures
from ..problem import Problem
from ..residual.missing import MissingPairs
from ..select.clusters import PRECISIONS, ClusterFit
from .cluster_functions import LeftOver, left_over
from .components import Basis, coefficients, seen, seen_lobes
from .functions import residual_functions
from .lookups import Lookups
from .normal import NormalMatrix, normal_matrix
from .projections import Projections, project

# Largest loss by rounding the weights to their stored type: less than any figure shows.
MAX_ROUNDING_DB = 0.02
# Largest violation of the optimality conditions of the weights, relative to the largest product.
TOLERANCE = 1e-4

Advance = Callable[[int], object]


@dataclass(frozen=True)
class Refit:
    """What the refit gives.

    Attributes:
        entries: lobes of all texels and their weights, as stored.
        weight_type: number type of the stored weights.
        totals: squared errors over all measured values.
        weighted: the same with the weights of the values; None where these are all 1.
        solvers: problems solved, by solver and status.
        components: functions as codes `[R, V, L, C]` and scales `[R, V]`, and coefficients as
            codes `[T, R]` and scales `[R]`; None for none.
        clusters: residuals as codes `[K, V, L, C]` and scales `[K]`; None for none.
    """

    entries: SparseWeights
    weight_type: torch.dtype
    totals: Totals
    weighted: Totals | None
    solvers: StatusCounts
    components: tuple[Tensor, Tensor, Tensor, Tensor] | None = None
    clusters: tuple[Tensor, Tensor] | None = None


@dataclass(frozen=True)
class System:
    """The least-squares problem of weights and coefficients, for one weighting of the errors.

    Attributes:
        lookups: what each pixel shows.
        normal: normal matrix of the entries.
        products: of the pictures.
        basis: R functions beside the lobes.
    """

    lookups: Lookups
    normal: NormalMatrix
    products: Projections
    basis: Basis

    def error(self, weight: Tensor) -> float:
        """Squared error of the lobes alone with weights `[N, C]`."""
        product = (self.normal.matrix @ weight).double()
        value = (weight.double() * (product - 2.0 * self.products.lobes)).sum()
        return max(self.products.energy + float(value), 0.0)

    def residual_products(self, entries: SparseWeights) -> Tensor:
        """Products `[T, R]` float64 of the functions with what the lobes leave."""
        return self.products.functions - seen_lobes(entries, self.basis, self.lookups)

    def totals(self, entries: SparseWeights, coefficient: Tensor) -> Totals:
        """Squared errors of a fit with coefficients `[T, R]`."""
        along = 2.0 * self.residual_products(entries)
        along = along - seen(coefficient, self.basis, self.lookups).double()
        taken = float((coefficient.double() * along).sum())
        without, energy = self.error(entries.weight), self.products.energy
        mean = max(energy - self.products.means, 0.0)
        return Totals(energy, without, max(without - taken, 0.0), mean)


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
    passes = 2 - problem.weights.uniform + config.residual.clusters
    total = passes * len(problem.btf.view)
    with problem.context.progress.stage("pictures", total, "views") as advance:
        return _refit(problem, clusters.labels, lobes, entries, advance)


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
    problem: Problem, labels: Tensor, lobes: LobeBatch, entries: SparseWeights, advance: Advance
) -> Refit:
    """`refit_pictures` by one pass over the pictures, or some more."""
    context, config = problem.context, problem.config
    setup = Setup(problem, lobes, labels, _functions(problem, lobes, entries), advance)
    with context.watch("refit"):
        system = setup.system(entries, problem.weights)
        entries, solvers = _weights(system, entries, config.refit.steps)
        kind, entries = _stored(config.storage.weights, system, entries)
    with context.watch("residual"):
        found = coefficients(
            system.residual_products(entries), system.basis, system.lookups, config.refit.steps
        )
        code, scale = encode_coefficients(found)
        stored = decode_coefficients(code, scale)
        functions = setup.functions.transpose(0, 1)  # [R, V, L, C]
        components = (*encode_functions(functions, torch.float16), code, scale)
    with context.watch("evaluate"):
        weighted = system.totals(entries, stored)
        totals = weighted
        if not problem.weights.uniform:
            totals = setup.system(entries, UNIFORM).totals(entries, stored)
    own = None
    if config.residual.clusters:
        with context.watch("residual"):
            own, totals, weighted = setup.clusters(entries, (functions, stored), totals, weighted)
    return Refit(
        entries,
        kind,
        totals,
        None if problem.weights.uniform else weighted,
        solvers,
        components if config.residual.rank else None,
        own,
    )


def _functions(problem: Problem, lobes: LobeBatch, entries: SparseWeights) -> Tensor:
    """The functions of the residual without the weights of pairs, `[V, R, L, C]`.

    At missing pairs they are interpolated, as the residual of a cluster is.
    """
    btf, scale = problem.btf, problem.weights.scale(problem.device)
    functions = residual_functions(problem, lobes, entries)  # [D, R, C]
    if scale is not None:
        functions = functions / torch.where(scale > 0.0, scale, 1.0)[:, None, None]
    gaps = MissingPairs.of(btf.measured, btf.light, btf.view)
    if gaps is not None:
        functions = gaps.filled(functions.flatten(1)).view(functions.shape)
    shape = (len(btf.view), len(btf.light))
    return functions.unflatten(0, shape).transpose(1, 2).contiguous()


@dataclass(frozen=True)
class Setup:
    """What all systems of a refit have in common.

    Attributes:
        problem: of the fit.
        lobes: J lobes, on its device.
        labels: clusters of the texels, `[T]`.
        functions: R functions without weights of pairs, `[V, R, L, C]`.
        advance: called with the number of views done.
    """

    problem: Problem
    lobes: LobeBatch
    labels: Tensor
    functions: Tensor
    advance: Advance

    def rho(self) -> Tensor:
        """Values of the lobes without weights of pairs, `[V, J, L]`."""
        values = self.problem.grid().unscaled.eval(self.lobes)
        views = len(self.problem.btf.view)
        return values.view(len(values), views, -1).transpose(0, 1).contiguous()

    def lookups(self, weights: Weights) -> Lookups:
        """What each pixel shows, with the weights of pixels."""
        problem = self.problem
        return Lookups.build(
            problem.field(),
            problem.btf.view,
            None if problem.relief is None else problem.relief.drift,
            weights.of_texels(slice(None)),
            problem.device,
        )

    def scale(self, weights: Weights) -> Tensor | None:
        """Scale of every pair, `[D]`; 0 where nothing was measured; None: 1."""
        measured = self.problem.btf.measured
        if weights.uniform and measured is not None:
            return measured.to(self.problem.device).float()
        return weights.scale(self.problem.device)

    def system(self, entries: SparseWeights, weights: Weights) -> System:
        """The system of some weights, which may be uniform; by a pass over the pictures."""
        problem, scale = self.problem, self.scale(weights)
        rho, functions = self.rho(), self.functions
        if scale is not None:
            by_view = scale.view(len(rho), -1)
            rho = rho * by_view[:, None]
            functions = functions * by_view[:, None, :, None]
        lookups = self.lookups(weights)
        products = problem.context.once(
            "pictures" if weights is problem.weights else "pictures-plain",
            Projections,
            lambda: project(
                problem.pictures,
                scale,
                lookups,
                entries,
                rho,
                functions,
                self.labels,
                problem.context.ranks,
                self.advance,
            ),
        )
        normal = normal_matrix(entries, rho, lookups)
        return System(lookups, normal, products, Basis.build(functions, rho))

    def clusters(
        self,
        entries: SparseWeights,
        components: tuple[Tensor, Tensor],
        totals: Totals,
        weighted: Totals,
    ) -> tuple[tuple[Tensor, Tensor], Totals, Totals]:
        """Codes `[K, V, L, C]` and scales `[K]` of the residuals of the clusters, and the errors.

        Args:
            entries: fit of all texels.
            components: functions `[R, V, L, C]` and coefficients `[T, R]`.
            totals, weighted: errors without the residual of the clusters.
        """
        problem, weights = self.problem, self.problem.weights
        functions, coefficient = components
        own = (functions.transpose(0, 1), coefficient) if len(functions) else None

        def left(of: Weights) -> LeftOver:
            return left_over(
                problem.pictures,
                self.lookups(of),
                entries,
                self.rho(),
                self.labels,
                problem.context.ranks,
                self.advance,
                components=own,
            )

        fitted = left(weights)
        found = fitted.functions()
        gaps = MissingPairs.of(problem.btf.measured, problem.btf.light, problem.btf.view)
        if gaps is not None:
            rows = found.flatten(1, 2).transpose(0, 1)  # [D, K, C]
            found = gaps.filled(rows.flatten(1)).view_as(rows).transpose(0, 1).view_as(found)
        code, scale = encode_residual(found, PRECISIONS[problem.config.residual.precision])
        values = decode_residual(code, scale)
        by_weight = fitted.error(values, self.scale(weights))
        weighted = replace(weighted, with_residual=by_weight)
        plain = by_weight
        if not problem.weights.uniform:
            plain = left(UNIFORM).error(values, self.scale(UNIFORM))
        return (code.cpu(), scale.cpu()), replace(totals, with_residual=plain), weighted


def _weights(
    system: System, entries: SparseWeights, steps: int
) -> tuple[SparseWeights, StatusCounts]:
    """The weights of least error, and how their solver ended."""
    if not system.lookups.mixed:  # each texel is alone, and its weights are best already
        return entries, StatusCounts.none()
    solved = sparse_nnls(
        system.normal.matrix,
        system.normal.diagonal,
        system.products.lobes.float(),
        entries.weight,
        steps=steps,
        tolerance=TOLERANCE,
    )
    counts = StatusCounts.of(Solver.SPARSE_NNLS, solved.status)
    return replace(entries, weight=solved.weights), counts


def _stored(
    asked: str, system: System, entries: SparseWeights
) -> tuple[torch.dtype, SparseWeights]:
    """The number type of the weights in the file, and the entries as it holds them."""
    if asked != "auto":
        kind = WEIGHT_TYPES[asked]
        return kind, rounded(entries, kind)
    before = snr_db(system.products.energy, system.error(entries.weight))
    for kind in WEIGHT_TYPES.values():
        found = rounded(entries, kind)
        if before - snr_db(system.products.energy, system.error(found.weight)) <= MAX_ROUNDING_DB:
            break
    return kind, found
