"""The residual at direction pairs that were not measured, interpolated from their neighbours.

References:
    [She68] Donald Shepard, A Two-Dimensional Interpolation Function for Irregularly-Spaced Data,
        ACM National Conference, 1968.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from ...geometry.directions import direction_pairs
from ...geometry.neighbours import nearest

# Measured pairs from which a missing pair is interpolated, by inverse squared distance [She68].
NEIGHBOURS = 8
# Least squared distance, far under that of measured directions: its inverse stays finite.
LEAST_DISTANCE = 1e-8


@dataclass(frozen=True)
class MissingPairs:
    """M missing pairs and their measured neighbours.

    Attributes:
        pair: indices of the missing pairs, `[M]`.
        neighbour: indices of n measured pairs near each, `[M, n]`.
        weight: of each neighbour, `[M, n]`; rows sum to 1.
    """

    pair: Tensor
    neighbour: Tensor
    weight: Tensor

    @classmethod
    def of(cls, measured: Tensor | None, light: Tensor, view: Tensor) -> MissingPairs | None:
        """As `build`; None if `measured [D]` is None, which says that all pairs are."""
        return None if measured is None else cls.build(measured, light, view)

    @classmethod
    def build(cls, measured: Tensor, light: Tensor, view: Tensor) -> MissingPairs:
        """Finds the neighbours of all pairs that are not measured.

        The squared distance of two pairs is that of their lights plus that of their views.

        Args:
            measured: `[D]` bool.
            light, view: measured directions, `[L, 3]` and `[V, 3]`.
        """
        missing = torch.nonzero(~measured).squeeze(1)
        known = torch.nonzero(measured).squeeze(1)
        pairs = torch.cat(direction_pairs(light, view), dim=1)  # [D, 6]
        distance, index = nearest(pairs[missing], pairs[known], min(NEIGHBOURS, len(known)))
        weight = 1.0 / distance.square().clamp(min=LEAST_DISTANCE)
        weight = (weight / weight.sum(1, keepdim=True)).float()
        return cls(missing, known[index], weight)

    def filled(self, values: Tensor) -> Tensor:
        """Values `[D, C]` with those of missing pairs interpolated."""
        pair, neighbour, weight = (
            part.to(values.device) for part in (self.pair, self.neighbour, self.weight)
        )
        found = torch.einsum("mn,mnc->mc", weight.to(values), values[neighbour])
        return values.index_copy(0, pair, found)
