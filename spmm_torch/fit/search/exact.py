"""Errors of mixtures in the measure of the objective itself, where that is not the squared error.

Weights turn squared errors into those of compressed values near the truth only: far from it, light
that is too much counts more than in cube roots, and light that is missing counts less.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import torch
from torch import Tensor

from ...lobes.batch import Feasible
from ...lobes.grid import DirectionGrid
from ...runtime.memory import slices
from ...solvers.curved import refine_curved
from ..glossy.compression import Compression
from .functions import LobeFunctions
from .mixtures import Mixtures


@dataclass(frozen=True)
class ExactErrors:
    """Errors of compressed values of S samples.

    Attributes:
        grid: the pairs, unscaled.
        compression: of the values.
        signals: the samples without weights, `[S, C, D]`.
        factor: of the errors of each pair, `[D]`.
    """

    grid: DirectionGrid
    compression: Compression
    signals: Tensor
    factor: Tensor

    @classmethod
    def of(
        cls, grid: DirectionGrid, compression: Compression, values: Tensor, pair: Tensor
    ) -> ExactErrors:
        """Those of samples.

        Args:
            grid: the pairs.
            compression: of the values.
            values: of the samples, without weights, `[S, C, D]`.
            pair: weights of squared errors, which `compression` has a part in, `[D]`.
        """
        factor = pair.double().cpu() / compression.curvature(compression.size)
        return cls(grid.unscaled, compression, values, factor.to(values))

    def energy(self) -> Tensor:
        """The error of each sample without any lobe, `[S]` float64."""
        rows = torch.arange(len(self.signals), device=self.signals.device)
        return self._total(torch.zeros_like(self.signals), rows)

    def loss(self, mixtures: Mixtures, rows: Tensor, block: int) -> Tensor:
        """The errors `[s]` float64 of mixtures of the samples `rows [s]`, some at a time."""
        parts = []
        for chunk in slices(len(rows), block):
            some = Mixtures(*(part[chunk] for part in mixtures.tensors()))
            parts.append(self._total(some.values(self.grid), rows[chunk]))
        return torch.cat(parts)

    def downward(self, mixtures: Mixtures, rows: Tensor) -> Tensor:
        """Minus half the gradient of the errors along the values, `[s, C, D]`."""
        return -self._slopes(mixtures.values(self.grid), rows)[0]

    def refined(
        self,
        mixtures: Mixtures,
        rows: Tensor,
        feasible: Feasible,
        steps: int,
        tolerance: float,
        block: int,
    ) -> Mixtures:
        """Mixtures of the samples `rows [s]` whose errors are lower, at least no higher."""
        functions = LobeFunctions(self.grid, feasible, mixtures.model)
        found = refine_curved(
            functions.linearized,
            functions.project,
            lambda values, own: self._penalty(values, rows[own]),
            mixtures.coordinates,
            mixtures.weights,
            mixtures.present,
            iterations=steps,
            tolerance=tolerance,
            block=block,
        )
        return replace(
            mixtures, coordinates=found.coordinates, weights=found.weights, loss=found.loss
        )

    def _penalty(self, values: Tensor, rows: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """The errors `[s]`, half their gradient and half their curvature, `[s, C, D]`."""
        return self._total(values, rows), *self._slopes(values, rows)

    def _total(self, values: Tensor, rows: Tensor) -> Tensor:
        """The errors `[s]` float64 of values `[s, C, D]`."""
        own, told = self.compression, self.signals[rows]
        seen = (own.compressed(values) - own.compressed(told)).square()
        plain = (values - told).square() if own.plain else 0.0
        error = self.factor * (own.plain * plain + own.seen * seen)
        return error.sum((1, 2), dtype=torch.float64)

    def _slopes(self, values: Tensor, rows: Tensor) -> tuple[Tensor, Tensor]:
        """Half the gradient and half the curvature of the errors, `[s, C, D]`."""
        own, told = self.compression, self.signals[rows]
        slope = (values + own.dark) ** (-0.5 * own.exponent)
        seen = (own.compressed(values) - own.compressed(told)) * slope
        gradient = self.factor * (own.plain * (values - told) + own.seen * seen)
        return gradient, self.factor * own.curvature(values)
