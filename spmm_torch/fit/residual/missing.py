"""What a residual is at direction pairs that were not measured: as at their nearest neighbours."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

# Measured pairs that a missing one is interpolated from, by inverse squared distance [She68].
NEIGHBOURS = 8
# Distances between missing and measured pairs that are held at once: 128 MB.
BLOCK_DISTANCES = 1 << 25
# Keeps the inverse of a squared distance finite; measured directions are further apart.
NEAREST = 1e-8


@dataclass(frozen=True)
class MissingPairs:
    """M missing pairs and where their values come from.

    References:
        [She68] Shepard, A two-dimensional interpolation function for irregularly-spaced data,
            ACM National Conference 1968.

    Attributes:
        place: of the missing pairs, `[M]`.
        source: measured pairs near each, `[M, n]`.
        share: of each of them, `[M, n]`, rows sum to 1.
    """

    place: Tensor
    source: Tensor
    share: Tensor

    @classmethod
    def of(cls, measured: Tensor | None, light: Tensor, view: Tensor) -> MissingPairs | None:
        """Those that are not `measured [D]`; None if there are none."""
        return None if measured is None else cls.build(measured, light, view)

    @classmethod
    def build(cls, measured: Tensor, light: Tensor, view: Tensor) -> MissingPairs:
        """Finds the neighbours of all pairs that are not `measured [D]`.

        The squared distance of two pairs is that of their lights plus that of their views.
        """
        place = torch.nonzero(~measured).squeeze(1)
        known = torch.nonzero(measured).squeeze(1)
        lights = len(light)
        of_light = torch.cdist(light.double(), light.double()).square()  # [L, L]
        of_view = torch.cdist(view.double(), view.double()).square()  # [V, V]
        near, distance = [], []
        for part in place.split(max(1, BLOCK_DISTANCES // len(known))):
            between = of_light[part % lights][:, known % lights]
            between = between + of_view[part // lights][:, known // lights]
            least = between.topk(min(NEIGHBOURS, len(known)), dim=1, largest=False)
            near.append(known[least.indices])
            distance.append(least.values)
        share = 1.0 / torch.cat(distance).clamp(min=NEAREST)
        share = (share / share.sum(1, keepdim=True)).float()
        return cls(place, torch.cat(near), share)

    def filled(self, values: Tensor) -> Tensor:
        """Values `[D, C]` with those of missing pairs replaced."""
        place, source, share = (
            part.to(values.device) for part in (self.place, self.source, self.share)
        )
        near = torch.einsum("mn,mnc->mc", share.to(values), values[source])
        return values.index_copy(0, place, near)
