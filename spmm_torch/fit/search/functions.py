"""Lobes of given models as functions of their search coordinates, which a search refines."""

from __future__ import annotations

from dataclasses import dataclass

from torch import Tensor

from ...brdf import REGISTRY
from ...lobes.batch import Feasible
from ...lobes.grid import DirectionGrid
from ...lobes.ragged import Grouped, in_spans


@dataclass
class LobeFunctions:
    """Lobes of given models as functions of their coordinates, for `refine_mixtures`.

    Every method takes coordinates `[s, M, P]` of the mixtures `rows [s]`.

    Attributes:
        grid, feasible: of the stage.
        model: `[S, M]`.
        last: the rows that were evaluated last, and their lobes by model.
    """

    grid: DirectionGrid
    feasible: Feasible
    model: Tensor
    last: tuple[Tensor | None, Grouped | None] = (None, None)

    def values(self, coordinates: Tensor, rows: Tensor) -> Tensor:
        """rho `[s, M, D]`."""
        return self.grid.values(self.model[rows], coordinates, self._grouped(rows))

    def linearized(self, coordinates: Tensor, rows: Tensor) -> Tensor:
        """rho and d rho / d coordinates, `[s, M, 1 + P, D]`."""
        return self.grid.linearized(self.model[rows], coordinates, self._grouped(rows))

    def project(self, coordinates: Tensor, rows: Tensor) -> Tensor:
        """The nearest feasible coordinates `[s, M, P]`."""
        model = self.model[rows].reshape(-1)
        return self.feasible.project(model, coordinates.flatten(0, 1)).view_as(coordinates)

    def _grouped(self, rows: Tensor) -> Grouped | None:
        """The lobes of the mixtures `rows [s]` by model; the host waits to know it anew."""
        if rows is not self.last[0]:
            self.last = rows, in_spans(self.model[rows].reshape(-1), len(REGISTRY))
        return self.last[1]
