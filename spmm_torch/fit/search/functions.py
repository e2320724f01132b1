"""Lobes of given models as functions of their coordinates, as solvers take them."""

from __future__ import annotations

from dataclasses import dataclass

from torch import Tensor

from ...lobes.batch import Feasible
from ...lobes.grid import DirectionGrid


@dataclass(frozen=True)
class LobeFunctions:
    """Lobes of given models as functions of their coordinates, for `refine_mixtures`.

    Every method takes coordinates `[s, M, P]` of the mixtures `rows [s]`.

    Attributes:
        grid, feasible: of the stage.
        model: `[S, M]`.
    """

    grid: DirectionGrid
    feasible: Feasible
    model: Tensor

    def values(self, coordinates: Tensor, rows: Tensor) -> Tensor:
        """rho `[s, M, D]`."""
        return self.grid.values(self.model[rows], coordinates)

    def linearized(self, coordinates: Tensor, rows: Tensor) -> Tensor:
        """rho and d rho / d coordinates, `[s, M, 1 + P, D]`."""
        return self.grid.linearized(self.model[rows], coordinates)

    def project(self, coordinates: Tensor, rows: Tensor) -> Tensor:
        """The nearest feasible coordinates `[s, M, P]`."""
        model = self.model[rows].reshape(-1)
        return self.feasible.project(model, coordinates.flatten(0, 1)).view_as(coordinates)
