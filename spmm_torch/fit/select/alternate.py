"""The sparse fit of the texels of one cluster, beside the residual that they share."""

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
from .texels import (
    Fit,
    Products,
    refit,
    residual_share,
    select,
    squared_errors,
    taken_by_residual,
    target_beside_residual,
)

# Texels that are selected for at once, so that the sums over their atoms take little memory; the
# same whatever memory there is.
CPU_TEXELS, CUDA_TEXELS = 1 << 12, 1 << 16
# Bytes that the selection holds for each texel and atom.
SELECT_BYTES = 120


@dataclass(frozen=True)
class Start:
    """What weights are first fit to: y - share * residual.

    Attributes:
        mean: weights that leave this residual, mean over the cluster, `[J, C]`; None: zeros, so
            that the residual is the cluster's mean.
        share: of the residual.
    """

    mean: Tensor | None
    share: float

    def of(self, atoms: Tensor) -> Start:
        """The same for some atoms, the others having no weight."""
        return self if self.mean is None else Start(self.mean[atoms], self.share)


# The lobes without a residual beside them, and with all of the mean.
LOBES_ALONE, DEVIATIONS = Start(None, 0.0), Start(None, 1.0)


def selection_blocks(products: Products) -> list[slice]:
    """Blocks of texels that are selected for at once."""
    size = CUDA_TEXELS if products.gram.device.type == "cuda" else CPU_TEXELS
    return list(slices(len(products.energy), size))


@dataclass(frozen=True)
class Solution:
    """The fits of this rank's texels, and what they make of the whole cluster.

    Attributes:
        fits: block by block.
        mean: weight of every atom, mean over the cluster, `[J, C]` float64.
        error: squared error of the lobes alone.
        taken: how much of it the residual takes away.
        start: from where it was found.
        solvers: the problems that were solved for it, by solver and status.
    """

    fits: list[Fit]
    mean: Tensor
    error: float
    taken: float
    start: Start
    solvers: StatusCounts

    def after(self, earlier: StatusCounts) -> Solution:
        """The same, with problems that were solved on the way."""
        return replace(self, solvers=earlier + self.solvers)

    def on_cpu(self) -> list[tuple[Tensor, Tensor]]:
        """Index and weights of every block."""
        return [(fit.index.cpu(), fit.weights.cpu()) for fit in self.fits]


@dataclass(frozen=True)
class ClusterProblem:
    """The sparse fit of one cluster; its texels are independent but for their residual."""

    products: Products
    config: FitConfig
    context: Context

    def solve(self, start: Start | None = None) -> Solution:
        """Fits the lobes alone, then, if settings want it, again beside the residual.

        If even so the residual leaves more error than the bare mean of the cluster, the weights
        are fit to the deviations from that mean: from there every turn can only improve.

        Args:
            start: what the pilot of these texels says: the lobes alone need not be fit anew.
        """
        products = self.products
        if not self.config.residual.joint:
            return self._alone()
        solvers = StatusCounts.none()
        if start is None:
            alone = self._alone()
            start, solvers = self._beside(alone), alone.solvers
        found = self._alternate(start).after(solvers)
        energy = float(self.context.ranks.sum(products.total(products.energy)))
        of_mean = energy - products.count * float(products.mean_energy.sum())
        # Where rounding alone makes the difference, of equal texels say, lobes must not be lost.
        if found.error - found.taken > of_mean + DOUBTFUL * energy:
            found = self._alternate(DEVIATIONS).after(found.solvers)
        return found

    def pilot(self) -> tuple[Start, Tensor, StatusCounts]:
        """What a pilot tells of all texels of its cluster.

        Returns:
            From where to fit them; which atoms the lobes alone need, `[J]` bool: beside a residual
            the same ones have less to do; and the problems that were solved.
        """
        found = self._alone()
        return self._beside(found), (found.mean > 0.0).any(1), found.solvers

    def _alone(self) -> Solution:
        return self._solution(LOBES_ALONE, self._each("select", self._select(LOBES_ALONE)))

    def _beside(self, alone: Solution) -> Start:
        """From where to fit beside the residual that the lobes alone leave."""
        share = residual_share(alone.error, alone.taken, self.products.effective)
        return Start(alone.mean, share)

    def _alternate(self, start: Start) -> Solution:
        """Selects beside the residual that weights leave, then fits both in turn."""
        found = self._solution(start, self._each("select", self._select(start)))
        for _ in range(self.config.residual.alternations):
            refitted = self._solution(start, self._each("refit", self._refit(found)))
            found = refitted.after(found.solvers)
        return found

    def _select(self, start: Start) -> Callable[[int, Products], Fit]:
        def step(_: int, part: Products) -> Fit:
            target = target_beside_residual(part, start.mean, start.share)
            return select(part, target, self.config.select, self.config.stagewise)

        return step

    def _refit(self, found: Solution) -> Callable[[int, Products], Fit]:
        def step(block: int, part: Products) -> Fit:
            target = target_beside_residual(part, found.mean, found.start.share)
            return refit(part, found.fits[block], target)

        return step

    def _each(self, stage: str, step: Callable[[int, Products], Fit]) -> list[tuple[Fit, float]]:
        """A step of a stage on every block of texels: its fit, and the error that this leaves."""
        results = []
        for block, texels in enumerate(selection_blocks(self.products)):
            part = self.products.part(texels)
            with self.context.watch(stage):
                fit = step(block, part)
            with self.context.watch("evaluate"):
                results.append((fit, float(part.total(squared_errors(part, fit)))))
        return results

    def _solution(self, start: Start, results: list[tuple[Fit, float]]) -> Solution:
        """What the fits of all blocks on all ranks make together."""
        atoms, channels = self.products.mean_correlation.shape
        total = torch.zeros(atoms, channels, dtype=torch.float64, device=self.products.gram.device)
        for texels, (fit, _) in zip(selection_blocks(self.products), results, strict=True):
            own = self.products.importance
            total += fit.total_weights(atoms, None if own is None else own[texels])
        mean = self.context.ranks.sum(total) / self.products.count
        own = torch.tensor(sum(error for _, error in results), dtype=torch.float64)
        error = float(self.context.ranks.sum(own))
        taken = taken_by_residual(self.products, mean)
        fits = [fit for fit, _ in results]
        solvers = StatusCounts.sum(fit.solvers for fit in fits)
        return Solution(fits, mean, error, taken, start, solvers)
