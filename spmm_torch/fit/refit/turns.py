"""Residual of rank R and weights of the lobes, fit in turn."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property

import torch
from torch import Tensor

from ...model.components import (
    decode_coefficients,
    decode_functions,
    encode_coefficients,
    encode_functions,
)
from ...model.lookup import SparseWeights
from ...runtime.allocator import give_back_freed_memory
from ..cluster import Clusters
from ..residual.trust import trust
from ..select.target import residual_weight
from .components import (
    coefficients,
    first_coefficients,
    gram_by_view,
    lobe_kernel,
    seen,
    seen_by_components,
    seen_by_lobes,
)
from .rank_residual import RankResidual
from .setup import Setup
from .sweep import Swept, sweep
from .system import MAX_ROUNDING_DB, ROUNDING, System

BYTES, HALVES = torch.int8, torch.float16
# Largest loss by bytes of the coefficients: as many bytes gain more as further components.
MAX_COEFFICIENT_DB = 0.1


@dataclass(frozen=True)
class Turns:
    """Functions and coefficients of the residual, and weights of the lobes, fit in turn.

    Attributes:
        setup, system: of the refit.
        entries: fit of all texels.
        coefficient: c, `[T, R]`.
        target: products that the weights are fit to, `[N, C]` float64.
        swept: functions of the last turn; None before the first.
        kept: share of them to keep at each pair, `[V, L]`; None: 1.
    """

    setup: Setup
    system: System
    entries: SparseWeights
    coefficient: Tensor
    target: Tensor
    swept: Swept | None = None
    kept: Tensor | None = None

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
                setup.scaled_rho.transpose(0, 1).flatten(1),
                problem.config.residual.rank,
            )
        return cls(setup, system, entries, first, system.products.lobes)

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
                    exact=self._nearly_exact,
                    kept=self.kept,
                ),
            )
            give_back_freed_memory()
            found = replace(self, swept=swept.to(problem.device))
            start = None if self.swept is None else self.coefficient
            found = replace(found, coefficient=found._coefficients(found._swept.products, start))
        return found._beside_residual() if problem.config.residual.joint else found

    def trusted(self, number: int) -> Turns:
        """The state after another turn that keeps of the residual what its neighbours foresee."""
        btf = self.setup.problem.pictures
        kept = trust(
            self._swept.functions, btf.light.to(self.coefficient), btf.view.to(self.coefficient)
        )
        return replace(self, kept=kept).next(number)

    def beside(self, entries: SparseWeights) -> Turns:
        """The state with other weights of the same lobes, the coefficients fit beside them."""
        swept = replace(self._swept, products=self._products(entries))
        found = self._coefficients(swept.products, self.coefficient)
        return replace(self, entries=entries, swept=swept, coefficient=found)

    @cached_property
    def lobes_error(self) -> float:
        """Squared error of the lobes alone."""
        return self.system.error(self.entries.weight)

    @cached_property
    def error(self) -> float:
        """Squared error of lobes and residual, before the residual is rounded."""
        return max(self.lobes_error - self._taken_away, 0.0)

    @cached_property
    def _taken_away(self) -> float:
        """Squared error that the residual takes away, before it is rounded."""
        return self._taken(self._swept.products, self.coefficient)

    def stored(self) -> RankResidual:
        """The residual as a file holds it.

        Bytes serve unless their rounding shows. It shows in the functions first, which all texels
        share and which cost little; in the coefficients only of models that are nearly exact.
        """
        products, found = self._swept.products, self.coefficient
        functions = self.setup.filled(self._swept.functions.transpose(0, 1))
        shows, counts = (_added(self.error, db) for db in (MAX_ROUNDING_DB, MAX_COEFFICIENT_DB))
        size = found.double().square().sum(0)  # [R]
        for of_functions, of_coefficients in ((BYTES, BYTES), (HALVES, BYTES), (HALVES, HALVES)):
            code, scale = encode_functions(functions, of_functions)
            rounding = (decode_functions(code, scale) - functions).double().square()
            coefficient = encode_coefficients(found, of_coefficients)
            stored = decode_coefficients(*coefficient)
            taken = self._taken(products, stored)
            by_functions = float(size @ rounding.flatten(1).sum(1))
            if by_functions <= shows and self._taken_away - taken <= counts:
                break
        return RankResidual(code, scale, *coefficient, taken)

    def _taken(self, products: Tensor, coefficient: Tensor) -> float:
        """Squared error that coefficients `[T, R]` take away, given products `[T, R]`."""
        along = 2.0 * products - seen(coefficient, self._gram, self.system.lookups).double()
        return float((coefficient.double() * along).sum())

    @property
    def _swept(self) -> Swept:
        """The functions of the last turn, of which there was one."""
        assert self.swept is not None
        return self.swept

    @property
    def _nearly_exact(self) -> bool:
        """Whether the lobes leave so little that products of pictures would not tell it."""
        return self.lobes_error < ROUNDING * self.system.products.energy

    @cached_property
    def _gram(self) -> Tensor:
        return gram_by_view(self._swept.functions, self.setup.scale)

    @cached_property
    def _kernel(self) -> Tensor:
        return lobe_kernel(self._swept.functions, self.setup.rho, self.setup.scale)

    def _coefficients(self, products: Tensor, start: Tensor | None) -> Tensor:
        """The coefficients of least error, `[T, R]`.

        Args:
            products: of the functions with what the lobes leave, `[T, R]`.
            start: first coefficients, `[T, R]`; None: zeros.
        """
        steps = self.setup.problem.config.refit.steps
        return coefficients(products, self._gram, self.system.lookups, steps, start)

    def _products(self, entries: SparseWeights) -> Tensor:
        """Products `[T, R]` of the functions with what the lobes of `entries` leave."""
        change = replace(entries, weight=entries.weight - self.entries.weight)
        return self._swept.products - seen_by_components(change, self._kernel, self.system.lookups)

    def _beside_residual(self) -> Turns:
        """Weights and coefficients fit for the errors without and with the residual together."""
        system, context = self.system, self.setup.problem.context
        with context.watch("refit"):
            steps = self.setup.problem.config.refit.steps
            target = self._target()
            entries = system.fitted(self.entries, target, steps)[0]
        with context.watch("residual"):
            return replace(self, target=target).beside(entries)

    def _target(self) -> Tensor:
        """Products of the lobes with Y - w R, `[N, C]` float64.

        Weights that are fit to it minimize (1 - w) ||Y - L||^2 + w ||Y - L - R||^2.
        """
        share = residual_weight(self.lobes_error, self._taken_away, math.inf)
        lookups = self.system.lookups
        shown = seen_by_lobes(self.coefficient, self._kernel, lookups, self.entries)
        return self.system.products.lobes - share * shown


def _added(error: float, decibels: float) -> float:
    """What makes a squared error that many decibels greater."""
    return (10.0 ** (0.1 * decibels) - 1.0) * error
