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
        last: the rows that were evaluated last, their models, bounds, and lobes by model.
    """

    grid: DirectionGrid
    feasible: Feasible
    model: Tensor
    last: tuple[Tensor, Tensor, Feasible, Grouped] | None = None

    def values(self, coordinates: Tensor, rows: Tensor) -> Tensor:
        """rho `[s, M, D]`."""
        model, _, grouped = self._of(rows)
        return self.grid.values(model, coordinates, grouped)

    def linearized(self, coordinates: Tensor, rows: Tensor) -> Tensor:
        """rho and d rho / d coordinates, `[s, M, 1 + P, D]`."""
        model, _, grouped = self._of(rows)
        return self.grid.linearized(model, coordinates, grouped)

    def project(self, coordinates: Tensor, rows: Tensor) -> Tensor:
        """The nearest feasible coordinates `[s, M, P]`."""
        return self._of(rows)[1].projected(coordinates.flatten(0, 1)).view_as(coordinates)

    def _of(self, rows: Tensor) -> tuple[Tensor, Feasible, Grouped]:
        """Models `[s, M]` of the mixtures `rows [s]`, bounds of their lobes, and these by model.

        The host waits to know the latter, so what was asked for last is kept.
        """
        if self.last is None or rows is not self.last[0]:
            model = self.model[rows]
            flat = model.reshape(-1)
            self.last = rows, model, self.feasible.of(flat), in_spans(flat, len(REGISTRY))
        return self.last[1:]
