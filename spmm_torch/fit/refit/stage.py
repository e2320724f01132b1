"""Stage refit: weights and residual fit to the measured pictures, through the relief.

Lobes are chosen on aligned values, which is cheap. Alignment resamples every picture, though, and
what it blurs is lost. Here the weights of the same lobes are fit to the pictures themselves, and so
is the residual; errors are exact and of the pictures too.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import torch
from torch import Tensor

from ...lobes.batch import LobeBatch
from ...metrics import Totals, snr_db
from ...model.components import (
    decode_coefficients,
    decode_functions,
    encode_coefficients,
    encode_functions,
)
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
from ..select.target import residual_weight
from .cluster_functions import LeftOver, left_over
from .components import (
    coefficients,
    first_coefficients,
    gram_by_view,
    lobe_kernel,
    seen,
    seen_by_components,
    seen_by_lobes,
)
from .lookups import Lookups
from .normal import NormalMatrix, normal_matrix
from .projections import Projections, project
from .sweep import Swept, sweep

# Largest loss by rounding the weights to their stored type: less than any figure shows.
MAX_ROUNDING_DB = 0.02
# Largest violation of the optimality conditions of the weights, relative to the largest product.
TOLERANCE = 1e-4
# How much weights are held to what they are on aligned values, as a share of the energy of a lobe
# that all views show: one that is hidden in nearly all views would grow without bounds to follow a
# trace of it in the others, and stand out where none was measured.
HELD = 0.01

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
        aligned: weights fit to aligned values, `[N, C]`.
        ridge: how much weights are held to these, `[N]`.
    """

    lookups: Lookups
    normal: NormalMatrix
    products: Projections
    aligned: Tensor
    ridge: Tensor

    def error(self, weight: Tensor) -> float:
        """Squared error of the lobes alone with weights `[N, C]`."""
        product = (self.normal.matrix @ weight).double()
        value = (weight.double() * (product - 2.0 * self.products.lobes)).sum()
        return max(self.products.energy + float(value), 0.0)

    def fitted(
        self, entries: SparseWeights, rhs: Tensor, steps: int
    ) -> tuple[SparseWeights, StatusCounts]:
        """The weights of least error for products `rhs [N, C]`, and how their solver ended.

        Those that hardly show in any picture stay near what they are on aligned values.
        """
        solved = sparse_nnls(
            self.normal.matrix,
            self.normal.diagonal,
            rhs.float() + self.ridge[:, None] * self.aligned,
            entries.weight,
            ridge=self.ridge,
            steps=steps,
            tolerance=TOLERANCE,
        )
        counts = StatusCounts.of(Solver.SPARSE_NNLS, solved.status)
        return replace(entries, weight=solved.weights), counts

    def totals(self, weight: Tensor, taken: float) -> Totals:
        """Squared errors with weights `[N, C]`, of which the residual takes some away."""
        without, energy = self.error(weight), self.products.energy
        mean = max(energy - self.products.means, 0.0)
        return Totals(energy, without, max(without - taken, 0.0), mean)


@dataclass(frozen=True)
class RankResidual:
    """The residual of rank R as a file holds it, and what it takes off the squared error.

    Attributes:
        code: of the functions, `[R, V, L, C]`.
        scale: of the functions, `[R, V]`.
        coefficient: codes `[T, R]`.
        coefficient_scale: `[R]`.
        taken: squared error, by weight.
    """

    code: Tensor
    scale: Tensor
    coefficient: Tensor
    coefficient_scale: Tensor
    taken: float

    @property
    def functions(self) -> Tensor:
        """B `[V, R, L, C]`."""
        return decode_functions(self.code, self.scale).transpose(0, 1)

    @property
    def coefficients(self) -> Tensor:
        """c `[T, R]`."""
        return decode_coefficients(self.coefficient, self.coefficient_scale)


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
    passes = 1 + config.refit.sweeps + 2 * (not problem.weights.uniform) + config.residual.clusters
    total = passes * len(problem.btf.view)
    with problem.context.progress.stage("pictures", total, "views") as advance:
        return _refit(problem, clusters, lobes, entries, advance)


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
    problem: Problem, clusters: Clusters, lobes: LobeBatch, entries: SparseWeights, advance: Advance
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
    with context.watch("refit"):
        entries = turns.entries if turns else entries
        kind, entries = _stored(config.storage.weights, system, entries)
    components, own, taken = None, None, 0.0
    if turns is not None:
        with context.watch("residual"):
            components = turns.stored(entries)
            taken = components.taken
    if config.residual.clusters:
        with context.watch("residual"):
            own, taken = setup.clusters(entries, components, system)
    weighted = totals = system.totals(entries.weight, taken)
    if not uniform:
        with context.watch("evaluate"):
            totals = setup.plain_totals(entries, components, own)
    coded = components and (
        components.code,
        components.scale,
        components.coefficient,
        components.coefficient_scale,
    )
    return Refit(entries, kind, totals, None if uniform else weighted, solvers, coded, own)


@dataclass(frozen=True)
class Setup:
    """What all passes of a refit have in common.

    Attributes:
        problem: of the fit.
        lobes: J lobes, on its device.
        labels: clusters of the texels, `[T]`.
        advance: called with the number of views done.
    """

    problem: Problem
    lobes: LobeBatch
    labels: Tensor
    advance: Advance

    @cached_property
    def rho(self) -> Tensor:
        """Values of the lobes without weights of pairs, `[V, J, L]`."""
        values = self.problem.grid().unscaled.eval(self.lobes)
        views = len(self.problem.btf.view)
        return values.view(len(values), views, -1).transpose(0, 1).contiguous()

    @cached_property
    def scale(self) -> Tensor | None:
        """Square roots of the weights of pairs, `[D]`; None: 1."""
        return self.problem.weights.scale(self.problem.device)

    def lookups(self, importance: Tensor | None) -> Lookups:
        """What each pixel shows, with weights of pixels `[T]`; None: 1."""
        problem = self.problem
        drift = None if problem.relief is None else problem.relief.drift
        return Lookups.build(problem.field(), problem.btf.view, drift, importance, problem.device)

    def system(self, entries: SparseWeights) -> System:
        """The system of the weights, by a pass over the pictures."""
        problem, rho = self.problem, self.rho
        if self.scale is not None:
            rho = rho * self.scale.view(len(rho), 1, -1)
        lookups = self.lookups(problem.weights.of_texels(slice(None)))
        products = problem.context.once(
            "pictures",
            Projections,
            lambda: project(
                problem.pictures,
                self.scale,
                lookups,
                entries,
                rho,
                self.labels,
                problem.context.ranks,
                self.advance,
            ),
        )
        ridge = HELD * rho.square().sum((0, 2))[entries.index]
        normal = normal_matrix(entries, rho, lookups)
        return System(lookups, normal, products, entries.weight, ridge)

    def clusters(
        self, entries: SparseWeights, components: RankResidual | None, system: System
    ) -> tuple[tuple[Tensor, Tensor], float]:
        """Residuals of the clusters, and what they and the components take off the squared error.

        Returns:
            ((codes `[K, V, L, C]`, scales `[K]`), squared error by weight).
        """
        problem = self.problem
        left = self._left(entries, components, system.lookups)
        functions = self.filled(left.functions())
        code, scale = encode_residual(functions, PRECISIONS[problem.config.residual.precision])
        error = left.error(decode_residual(code, scale), self.scale)
        return (code.cpu(), scale.cpu()), system.error(entries.weight) - error

    def plain_totals(
        self,
        entries: SparseWeights,
        components: RankResidual | None,
        clusters: tuple[Tensor, Tensor] | None,
    ) -> Totals:
        """Squared errors without any weights, over all measured values."""
        measured = self.problem.btf.measured
        scale = None if measured is None else measured.to(self.problem.device).float()
        lookups = self.lookups(None)
        alone = self._left(entries, None, lookups)
        without = whole = alone.error(None, scale)
        if components is not None or clusters is not None:
            left = self._left(entries, components, lookups)
            own = None
            if clusters is not None:
                own = decode_residual(*clusters).to(self.problem.device)
            whole = left.error(own, scale)
        return Totals(alone.value_energy(scale), without, whole, alone.mean_error(scale))

    def _left(
        self, entries: SparseWeights, components: RankResidual | None, lookups: Lookups
    ) -> LeftOver:
        """What lobes and components leave of the pictures."""
        own = None if components is None else (components.functions, components.coefficients)
        return left_over(
            self.problem.pictures,
            lookups,
            entries,
            self.rho,
            self.labels,
            self.problem.context.ranks,
            self.advance,
            components=own,
        )

    def filled(self, functions: Tensor) -> Tensor:
        """Functions `[R, V, L, C]` with their values at missing pairs interpolated."""
        btf = self.problem.btf
        gaps = MissingPairs.of(btf.measured, btf.light, btf.view)
        if gaps is None:
            return functions
        rows = functions.flatten(1, 2).transpose(0, 1)  # [D, R, C]
        filled = gaps.filled(rows.flatten(1)).view(rows.shape)
        return filled.transpose(0, 1).reshape(functions.shape)


@dataclass(frozen=True)
class Turns:
    """Functions and coefficients of the residual, and weights of the lobes, fit in turn.

    Attributes:
        setup, system: of the refit.
        entries: fit of all texels.
        coefficient: c, `[T, R]`.
        swept: functions for earlier coefficients; None before the first turn.
    """

    setup: Setup
    system: System
    entries: SparseWeights
    coefficient: Tensor
    swept: Swept | None = None

    @classmethod
    def start(
        cls, setup: Setup, system: System, clusters: Clusters, entries: SparseWeights
    ) -> Turns:
        """Coefficients from the principal coordinates of what the lobes leave."""
        problem = setup.problem
        with problem.context.watch("residual"):
            first = first_coefficients(
                clusters.points.to(problem.device),
                clusters.functions.to(problem.device),
                entries,
                problem.grid().eval(setup.lobes),
                problem.config.residual.rank,
            )
        return cls(setup, system, entries, first)

    def next(self, number: int) -> Turns:
        """The state after another turn, by a pass over the pictures."""
        problem, lookups = self.setup.problem, self.system.lookups
        with problem.context.watch("residual"):
            swept = problem.context.once(
                f"sweep-{number}",
                Swept,
                lambda: sweep(
                    problem.pictures,
                    self.setup.scale,
                    lookups,
                    self.entries,
                    self.setup.rho,
                    self.coefficient,
                    problem.context.ranks,
                    self.setup.advance,
                ),
            )
            found = replace(self, swept=swept)
            found = replace(found, coefficient=found._coefficients(swept.products))
        return found._beside_residual() if problem.config.residual.joint else found

    def stored(self, entries: SparseWeights) -> RankResidual:
        """The residual as a file holds it, beside lobes whose weights were rounded."""
        products = self._products(entries)
        code, scale = encode_coefficients(self._coefficients(products))
        stored = decode_coefficients(code, scale)
        along = 2.0 * products - seen(stored, self._gram, self.system.lookups).double()
        taken = float((stored.double() * along).sum())
        functions = self.setup.filled(self._functions.transpose(0, 1))
        return RankResidual(*encode_functions(functions, torch.int8), code, scale, taken)

    @property
    def _functions(self) -> Tensor:
        """B without the weights of pairs, `[V, R, L, C]`."""
        assert self.swept is not None
        return self.swept.functions

    @cached_property
    def _gram(self) -> Tensor:
        return gram_by_view(self._functions, self.setup.scale)

    @cached_property
    def _kernel(self) -> Tensor:
        return lobe_kernel(self._functions, self.setup.rho, self.setup.scale)

    def _coefficients(self, products: Tensor) -> Tensor:
        """The coefficients of least error, `[T, R]`, given products with what the lobes leave."""
        steps = self.setup.problem.config.refit.steps
        return coefficients(products, self._gram, self.system.lookups, steps)

    def _products(self, entries: SparseWeights) -> Tensor:
        """Products `[T, R]` of the functions with what the lobes of `entries` leave."""
        assert self.swept is not None
        change = replace(entries, weight=entries.weight - self.entries.weight)
        return self.swept.products - seen_by_components(change, self._kernel, self.system.lookups)

    def _beside_residual(self) -> Turns:
        """Weights and coefficients fit for the errors without and with the residual together.

        Weights that are fit to Y - w R minimize (1 - w) ||Y - L||^2 + w ||Y - L - R||^2.
        """
        system, context = self.system, self.setup.problem.context
        with context.watch("refit"):
            assert self.swept is not None
            without = system.error(self.entries.weight)
            own = self.coefficient
            along = 2.0 * self.swept.products - seen(own, self._gram, system.lookups).double()
            taken = float((own.double() * along).sum())
            share = residual_weight(without, taken, math.inf)
            shown = seen_by_lobes(own, self._kernel, system.lookups, self.entries)
            steps = self.setup.problem.config.refit.steps
            entries = system.fitted(self.entries, system.products.lobes - share * shown, steps)[0]
        with context.watch("residual"):
            products = self._products(entries)
            found = replace(self, coefficient=self._coefficients(products))
            return replace(found, entries=entries, swept=replace(self.swept, products=products))


def _weights(
    system: System, entries: SparseWeights, steps: int
) -> tuple[SparseWeights, StatusCounts]:
    """The weights of least error, and how their solver ended."""
    if not system.lookups.mixed:  # each texel is alone, and its weights are best already
        return entries, StatusCounts.none()
    return system.fitted(entries, system.products.lobes, steps)


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
            return kind, found
    return torch.float32, entries
