"""The mixtures of lobes that a search refines."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from ...lobes.grid import DirectionGrid


@dataclass(frozen=True)
class Mixtures:
    """Mixtures of S samples, at most M lobes each.

    Attributes:
        model: index into `MODEL_NAMES`, `[S, M]`.
        coordinates: search coordinates `[S, M, P]`.
        present: `[S, M]`, False for padding.
        weights: `[S, M, C]`.
        loss: remaining squared error `[S]`, float64.
    """

    model: Tensor
    coordinates: Tensor
    present: Tensor
    weights: Tensor
    loss: Tensor

    def values(self, grid: DirectionGrid) -> Tensor:
        """Values on all pairs of a grid, `[S, C, D]`."""
        weights = (self.weights * self.present[..., None]).transpose(1, 2)
        return weights @ grid.values(self.model, self.coordinates)

    def take(self, rows: Tensor) -> Mixtures:
        """The mixtures of samples `rows [s]`."""
        return Mixtures(*(part[rows] for part in self.tensors()))

    def put(self, rows: Tensor, other: Mixtures) -> None:
        """Overwrites the mixtures of samples `rows [s]` in place."""
        for mine, theirs in zip(self.tensors(), other.tensors(), strict=True):
            mine[rows] = theirs

    def better(self, other: Mixtures) -> Mixtures:
        """Of each sample the mixture of lower error, this one where both are alike."""
        lower = other.loss < self.loss  # False for NaN
        return Mixtures(
            *(
                torch.where(lower.view(-1, *[1] * (mine.dim() - 1)), theirs, mine)
                for mine, theirs in zip(self.tensors(), other.tensors(), strict=True)
            )
        )

    def tensors(self) -> tuple[Tensor, ...]:
        """All fields in their order, `[S, ...]` each."""
        return self.model, self.coordinates, self.present, self.weights, self.loss
