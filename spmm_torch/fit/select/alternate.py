"""The sparse fit of the texels of one cluster beside their common residual, both in turn."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from ...config.fit import FitConfig
from ...runtime.context import Context
from ...runtime.memory import slices
from ...solvers.status import StatusCounts
from ..residual.exact import DOUBTFUL
from .products import Products
from .target import residual_weight, taken_by_residual, target_beside_residual
from .texels import Fit, refit, select, squared_errors

# Texels of one block of the selection. Fixed, so that sums round the same whatever memory there is.
CPU_TEXELS, CUDA_TEXELS = 1 << 12, 1 << 16
# Bytes that the selection holds for each texel and atom.
SELECT_BYTES = 120


@dataclass(frozen=True)
class Start:
    """What the weights are fit to at first: y - weight * residual.

    Attributes:
        mean: weights x whose residual mean(y) - D mean(x) this is, mean over the cluster,
            `[J, C]`; None: zeros, so that the residual is the mean of the cluster.
        weight: of the residual.
    """

    mean: Tensor | None
    weight: float

    def of(self, atoms: Tensor) -> Start:
        """The start of a fit with the atoms `[N]` only."""
        return self if self.mean is None else Start(self.mean[atoms], self.weight)


# Starts without a residual, and with the mean of the cluster as the residual.
LOBES_ALONE, DEVIATIONS = Start(None, 0.0), Start(None, 1.0)


def selection_blocks(products: Products) -> list[slice]:
    """Blocks of texels for the selection."""
    size = CUDA_TEXELS if products.gram.device.type == "cuda" else CPU_TEXELS
    return list(slices(len(products.energy), size))


@dataclass(frozen=True)
class Solution:
    """The fits of the texels of this rank, and the errors of the whole cluster.

    Attributes:
        fits: of the blocks of texels, in their order.
        mean: weight of every atom, mean over the cluster, `[J, C]` float64.
        error: squared error of the lobes alone.
        taken: squared error that the residual takes away.
        start: of the fit.
        solvers: problems solved, by solver and status.
    """

    fits: list[Fit]
    mean: Tensor
    error: float
    taken: float
    start: Start
    solvers: StatusCounts

    def after(self, earlier: StatusCounts) -> Solution:
        """The same solution with the problems solved before it."""
        return replace(self, solvers=earlier + self.solvers)

    def on_cpu(self) -> list[tuple[Tensor, Tensor]]:
        """Index `[n, M]` and weights `[n, M, C]` of every block."""
        return [(fit.index.cpu(), fit.weights.cpu()) for fit in self.fits]


@dataclass(frozen=True)
class ClusterProblem:
    """The sparse fit of one cluster, whose texels only have their residual in common."""

    products: Products
    config: FitConfig
    context: Context

    def solve(self, start: Start | None = None) -> Solution:
        """Fits the lobes alone and then, if the settings say so, again beside the residual.

        If the error with residual is then above that of the bare mean of the cluster, the weights
        are fit to the deviations from that mean: from there every turn can only improve.

        Args:
            start: found by the pilot; None: found by a fit of the lobes alone.
        """
        products = self.products
        if not self.config.residual.beside_lobes:
            return self._alone()
        solvers = StatusCounts.none()
        if start is None:
            alone = self._alone()
            start, solvers = self._beside(alone), alone.solvers
        found = self._alternate(start).after(solvers)
        energy = float(self.context.ranks.sum(products.total(products.energy)))
        of_mean = energy - products.count * float(products.mean_energy.sum())
        # A difference that is rounding, as with equal texels, must not cost the lobes.
        if found.error - found.taken > of_mean + DOUBTFUL * energy:
            found = self._alternate(DEVIATIONS).after(found.solvers)
        return found

    def pilot(self) -> tuple[Start, Tensor, StatusCounts]:
        """Fits some texels of a cluster to guide the fit of all.

        Returns:
            (start for all texels, `[J]` bool: atoms that the lobes alone use, problems solved).
            Beside a residual no further atoms are needed.
        """
        found = self._alone()
        return self._beside(found), (found.mean > 0.0).any(1), found.solvers

    def _alone(self) -> Solution:
        """The fit without a residual."""
        return self._solution(LOBES_ALONE, self._each("select", self._select(LOBES_ALONE)))

    def _beside(self, alone: Solution) -> Start:
        """The start beside the residual that the lobes alone leave."""
        weight = residual_weight(alone.error, alone.taken, self.products.effective)
        return Start(alone.mean, weight)

    def _alternate(self, start: Start) -> Solution:
        """Selects beside the residual of `start`, then fits residual and weights in turn."""
        found = self._solution(start, self._each("select", self._select(start)))
        for _ in range(self.config.residual.alternations):
            refitted = self._solution(start, self._each("refit", self._refit(found)))
            found = refitted.after(found.solvers)
        return found

    def _select(self, start: Start) -> Callable[[int, Products], Fit]:
        """The step that selects atoms for the texels of a block."""

        def step(_: int, part: Products) -> Fit:
            target = target_beside_residual(part, start.mean, start.weight)
            return select(part, target, self.config.select, self.config.stagewise)

        return step

    def _refit(self, found: Solution) -> Callable[[int, Products], Fit]:
        """The step that fits the weights of the same atoms beside the residual of `found`."""

        def step(block: int, part: Products) -> Fit:
            target = target_beside_residual(part, found.mean, found.start.weight)
            return refit(part, found.fits[block], target)

        return step

    def _each(self, stage: str, step: Callable[[int, Products], Fit]) -> list[tuple[Fit, float]]:
        """The fit of every block of texels by one step of a stage, and its squared error."""
        results = []
        for block, texels in enumerate(selection_blocks(self.products)):
            part = self.products.part(texels)
            with self.context.watch(stage):
                fit = step(block, part)
            with self.context.watch("evaluate"):
                results.append((fit, float(part.total(squared_errors(part, fit)))))
        return results

    def _solution(self, start: Start, results: list[tuple[Fit, float]]) -> Solution:
        """The solution made of the fits of all blocks on all ranks."""
        shape = self.products.mean_correlation.shape  # [J, C]
        total = self.products.mean_correlation.new_zeros(shape, dtype=torch.float64)
        for texels, (fit, _) in zip(selection_blocks(self.products), results, strict=True):
            own = self.products.importance
            total += fit.total_weights(len(total), None if own is None else own[texels])
        mean = self.context.ranks.sum(total) / self.products.count
        errors = torch.tensor(sum(error for _, error in results), dtype=torch.float64)
        error = float(self.context.ranks.sum(errors))
        taken = taken_by_residual(self.products, mean)
        fits = [fit for fit, _ in results]
        solvers = StatusCounts.sum(fit.solvers for fit in fits)
        return Solution(fits, mean, error, taken, start, solvers)
