"""The lobes of several samples while a search changes them."""

from __future__ import annotations

from dataclasses import dataclass

from torch import Tensor


@dataclass(frozen=True)
class Mixtures:
    """Lobes of S samples, M at most each.

    Attributes:
        model: `[S, M]`.
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

    def take(self, rows: Tensor) -> Mixtures:
        """The mixtures of some samples."""
        return Mixtures(*(part[rows] for part in self.tensors()))

    def put(self, rows: Tensor, other: Mixtures) -> None:
        """Overwrites the mixtures of some samples in place."""
        for mine, theirs in zip(self.tensors(), other.tensors(), strict=True):
            mine[rows] = theirs

    def tensors(self) -> tuple[Tensor, ...]:
        """All parts in their order."""
        return self.model, self.coordinates, self.present, self.weights, self.loss
