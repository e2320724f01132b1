"""Errors of mixtures in the measure of the objective itself, where that is not the squared error.

Weights turn squared errors into those of compressed values near the truth only: far from it, light
that is too much counts for more than in cube roots, and light that is missing for less. So lobes
are found by weighted squared errors, and kept where they lower the error that counts.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import torch
from torch import Tensor

from ...lobes.batch import Feasible, LobeBatch
from ...lobes.grid import DirectionGrid
from ...runtime.memory import slices
from ...solvers.curved import refine_curved
from ...solvers.nnls import nnls_shared_gram
from ..glossy.centre import centred
from ..glossy.compression import Compression
from ..glossy.energy import held_to_energy
from ..glossy.peaks import Unresolved
from .functions import LobeFunctions
from .mixtures import Mixtures


@dataclass(frozen=True)
class ExactErrors:
    """Errors of compressed values of S samples.

    Attributes:
        grid: the pairs, scaled by the square roots of the weights of squared errors.
        compression: of the values.
        values: of the samples, without weights, `[S, C, D]`.
        factor: of the errors of each pair, `[D]`.
        peak: that the pairs do not resolve: mixtures are judged as `held` makes them; None: as
            they are.
        resolved: width of the narrowest lobes that the pairs resolve.
    """

    grid: DirectionGrid
    compression: Compression
    values: Tensor
    factor: Tensor
    peak: Unresolved | None
    resolved: float

    @classmethod
    def of(
        cls,
        grid: DirectionGrid,
        compression: Compression,
        values: Tensor,
        pair: Tensor,
        peak: Unresolved | None,
        resolved: float,
    ) -> ExactErrors:
        """Those of samples; `pair [D]` are the weights of squared errors, the rest as above."""
        factor = pair.double().cpu() / compression.curvature(compression.size)
        return cls(grid, compression, values, factor.to(values), peak, resolved)

    @cached_property
    def energy(self) -> Tensor:
        """The error of each sample without any lobe, `[S]` float64."""
        rows = torch.arange(len(self.values), device=self.values.device)
        return self._total(torch.zeros_like(self.values), rows)

    def loss(self, mixtures: Mixtures, rows: Tensor, block: int) -> Tensor:
        """The errors `[s]` float64 of mixtures of the samples `rows [s]`, `block` at a time."""
        found = [rows.new_zeros(0, dtype=torch.float64)]
        for chunk in slices(len(rows), block):
            some = Mixtures(*(part[chunk] for part in mixtures.tensors()))
            found.append(self._total(self._values(some, rows[chunk]), rows[chunk]))
        return torch.cat(found)

    def downward(self, mixtures: Mixtures, rows: Tensor) -> Tensor:
        """What would lower the errors of samples `rows [s]` most, as a scaled signal, `[s, C, D]`.

        Its product with a scaled lobe is that of the lobe with minus half the gradient.
        """
        parts = self._apart(mixtures.values(self.grid.unscaled), rows)
        wanted = -self._slopes(*parts, rows)[0]
        scale = self.grid.scale
        if scale is None:
            return wanted
        return torch.where(scale > 0.0, wanted / torch.where(scale > 0.0, scale, 1.0), 0.0)

    def refined(
        self,
        mixtures: Mixtures,
        rows: Tensor,
        feasible: Feasible,
        steps: int,
        tolerance: float,
        block: int,
    ) -> Mixtures:
        """Mixtures of the samples `rows [s]` after a descent on the errors, `block` at a time."""
        functions = LobeFunctions(self.grid.unscaled, feasible, mixtures.model)
        result = refine_curved(
            functions.linearized,
            functions.project,
            lambda values, own: self._judged(values, rows[own]),
            mixtures.coordinates,
            mixtures.weights,
            mixtures.present,
            iterations=steps,
            tolerance=tolerance,
            block=block,
        )
        found = replace(mixtures, coordinates=result.coordinates, weights=result.weights)
        return replace(found, loss=self.loss(found, rows, block))

    def _values(self, mixtures: Mixtures, rows: Tensor) -> Tensor:
        """Values `[s, C, D]` of mixtures; of held lobes the weights are fit anew."""
        if self.peak is None:
            return mixtures.values(self.grid.unscaled)
        lobes = held(mixtures, self.grid, self.peak, self.resolved)
        plain = self.grid.unscaled.eval(lobes).unflatten(0, mixtures.present.shape)
        rho, signals = self.grid.scaled(plain), self.grid.scaled(self.values[rows])
        gram, correlation = rho @ rho.transpose(1, 2), signals @ rho.transpose(1, 2)
        solved = nnls_shared_gram(gram, correlation.double(), allowed=mixtures.present)
        return solved.weights.to(plain.dtype) @ plain

    def _total(self, values: Tensor, rows: Tensor) -> Tensor:
        """The errors `[s]` float64 of values `[s, C, D]`."""
        return self._sum(*self._apart(values, rows)[1:])

    def _judged(self, values: Tensor, rows: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """The errors `[s]` float64 of values `[s, C, D]`; see `_slopes`."""
        parts = self._apart(values, rows)
        return self._sum(*parts[1:]), *self._slopes(*parts, rows)

    def _apart(self, values: Tensor, rows: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Values `[s, C, D]` in the units that count, and what they are above the samples.

        Returns:
            (values; these minus the samples `rows [s]`; the same of compressed values).
        """
        values = values / self._unit[rows]
        seen = self.compression.compressed(values) - self._compressed[rows]
        return values, values - self._told[rows], seen

    def _sum(self, plain: Tensor, seen: Tensor) -> Tensor:
        """The errors `[s]` float64 of differences `[s, C, D]`; see `_apart`."""
        error = self.compression.seen * seen.square()
        if self.compression.plain:
            error = error + self.compression.plain * plain.square()
        return (self.factor * error).sum((1, 2), dtype=torch.float64)

    def _slopes(
        self, values: Tensor, plain: Tensor, seen: Tensor, rows: Tensor
    ) -> tuple[Tensor, Tensor]:
        """Half the gradient and half the curvature of the errors, `[s, C, D]`; see `_apart`."""
        own, unit = self.compression, self._unit[rows]
        slope = (values + own.dark) ** (-0.5 * own.exponent)
        gradient = self.factor * (own.plain * plain + own.seen * (seen * slope))
        return gradient / unit, self.factor * own.curvature(values) / unit.square()

    @cached_property
    def _unit(self) -> Tensor:
        """Unit of each sample, `[S, 1, 1]`."""
        return self.compression.units(self.values)

    @cached_property
    def _told(self) -> Tensor:
        """The samples in the units that count, `[S, C, D]`."""
        return self.values / self._unit

    @cached_property
    def _compressed(self) -> Tensor:
        """The same, compressed: roots are the most of what an error takes."""
        return self.compression.compressed(self._told)


def held(mixtures: Mixtures, grid: DirectionGrid, peak: Unresolved, resolved: float) -> LobeBatch:
    """The lobes `[S M]` of mixtures, padding included, of which narrow ones make up no light.

    Args:
        mixtures: of S samples.
        grid: the measured pairs.
        peak: what the pairs do not resolve.
        resolved: width of the narrowest lobes that the pairs resolve.
    """
    lobes = grid.decode(mixtures.model.flatten(), mixtures.coordinates.flatten(0, 1))
    weights = mixtures.weights * mixtures.present[..., None]
    lobes, weights = centred(lobes, weights.flatten(0, 1), grid, resolved)
    return held_to_energy(lobes, weights.view_as(mixtures.weights), peak, resolved)
