"""What all passes of a refit over the pictures have in common, and the passes themselves."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

from torch import Tensor

from ...lobes.batch import LobeBatch
from ...metrics import Totals
from ...model.lookup import SparseWeights
from ...model.residual import decode_residual, encode_residual
from ...runtime.allocator import give_back_freed_memory
from ..problem import Problem
from ..residual.missing import MissingPairs
from ..select.clusters import PRECISIONS
from .cluster_functions import LeftOver, left_over
from .lookups import Lookups
from .normal import normal_matrix
from .projections import Projections, project
from .rank_residual import RankResidual
from .system import HELD, System

Advance = Callable[[int], object]


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
    def scaled_rho(self) -> Tensor:
        """Values of the lobes with the weights of pairs, `[V, J, L]`."""
        return self.rho if self.scale is None else self.rho * self.scale.view(len(self.rho), 1, -1)

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
        give_back_freed_memory()
        problem, rho = self.problem, self.scaled_rho
        lookups = self.lookups(problem.weights.of_texels(slice(None)))
        normal = normal_matrix(entries, rho, lookups)
        give_back_freed_memory()
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
        return System(lookups, normal, products.to(problem.device), entries.weight, ridge)

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
        """Squared errors without any weights, over all measured values.

        Args:
            entries: fit of all texels, as stored.
            components: as stored; None for none.
            clusters: codes `[K, V, L, C]` and scales `[K]` of their residuals; None for none.
        """
        measured = self.problem.btf.measured
        scale = None if measured is None else measured.to(self.problem.device).float()
        return self.totals(entries, components, clusters, self.lookups(None), scale)

    def totals(
        self,
        entries: SparseWeights,
        components: RankResidual | None,
        clusters: tuple[Tensor, Tensor] | None,
        lookups: Lookups,
        scale: Tensor | None,
    ) -> Totals:
        """Exact squared errors, by a pass over the pictures or two.

        Args:
            entries: fit of all texels, as stored.
            components, clusters: residuals as stored; None for none.
            lookups: what each pixel shows, with the weights of pixels.
            scale: square roots of the weights of pairs, `[D]`; None: 1.
        """
        alone = self._left(entries, None, lookups)
        without = whole = alone.error(None, scale)
        if components is not None or clusters is not None:
            own = None
            if clusters is not None:
                own = decode_residual(*clusters).to(self.problem.device)
            whole = self._left(entries, components, lookups, own).error(None, scale)
        return Totals(alone.value_energy(scale), without, whole, alone.mean_error(scale))

    def _left(
        self,
        entries: SparseWeights,
        components: RankResidual | None,
        lookups: Lookups,
        clusters: Tensor | None = None,
    ) -> LeftOver:
        """What lobes, components and functions `[K, V, L, C]` of clusters leave of the pictures."""
        shared = None if components is None else (components.functions, components.coefficients)
        return left_over(
            self.problem.pictures,
            lookups,
            entries,
            self.rho,
            self.labels,
            self.problem.context.ranks,
            self.advance,
            components=shared,
            own=clusters,
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
