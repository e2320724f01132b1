"""The measured direction pairs on a device, as the stages evaluate lobes on them."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from ..geometry.directions import angular_spacing
from .batch import LobeBatch, decode
from .jacobian import eval_with_jacobian

# A lobe that correlates more than this with one that a search already has is that one.
SAME_LOBE = 0.999


@dataclass(frozen=True)
class DirectionGrid:
    """All pairs of L lights and V views, d = view * L + light.

    Attributes:
        light: `[1, 1, L, 3]`.
        view: `[1, V, 1, 3]`.
        scale: square roots of the weights of the pairs, `[D]`, by which all values of lobes are
            scaled; None: 1.
    """

    light: Tensor
    view: Tensor
    scale: Tensor | None = None

    @classmethod
    def build(
        cls, light: Tensor, view: Tensor, device: torch.device, scale: Tensor | None = None
    ) -> DirectionGrid:
        """The grid of lights `[L, 3]` and views `[V, 3]`."""
        scale = None if scale is None else scale.to(device)
        return cls(light.to(device)[None, None], view.to(device)[None, :, None], scale)

    @property
    def unscaled(self) -> DirectionGrid:
        """The same pairs without weights."""
        return DirectionGrid(self.light, self.view)

    @property
    def pair_count(self) -> int:
        """D."""
        return self.light.shape[2] * self.view.shape[1]

    @property
    def spacing(self) -> float:
        """The smaller of the angles between neighbouring lights and neighbouring views."""
        sets = self.light[0, 0], self.view[0, :, 0]
        return min(angular_spacing(directions.cpu()) for directions in sets)

    def eval(self, lobes: LobeBatch) -> Tensor:
        """Values of lobes on all pairs, `[J, D]`."""
        return self._scaled(lobes.eval(self.light, self.view).flatten(1))

    def eval_at(self, lobes: LobeBatch, pairs: Tensor) -> Tensor:
        """Values `[J, N]` of each lobe on pairs of its own, `[J, N]`."""
        values = lobes.eval(*self.at(pairs))
        return values if self.scale is None else values * self.scale[pairs]

    def _scaled(self, values: Tensor) -> Tensor:
        return values if self.scale is None else values * self.scale

    def at(self, pairs: Tensor) -> tuple[Tensor, Tensor]:
        """Directions (wi, wo), both `[..., 3]`, of pair indices `[...]`."""
        lights = self.light.shape[2]
        light = self.light[0, 0][pairs % lights]
        view = self.view[0, :, 0][torch.div(pairs, lights, rounding_mode="floor")]
        return light, view

    def values(self, model: Tensor, coordinates: Tensor) -> Tensor:
        """Values `[S, M, D]` of lobes `model [S, M]` at search `coordinates [S, M, P]`."""
        lobes = decode(model.reshape(-1), coordinates.flatten(0, 1))
        return self.eval(lobes).unflatten(0, model.shape)

    def jacobian(self, model: Tensor, coordinates: Tensor) -> tuple[Tensor, Tensor]:
        """Values `[S, M, D]` and slopes `[S, M, P, D]`."""
        rho, slope = eval_with_jacobian(
            model.reshape(-1), coordinates.flatten(0, 1), self.light, self.view
        )
        rho, slope = self._scaled(rho.flatten(1)), self._scaled(slope.flatten(2))
        return rho.unflatten(0, model.shape), slope.unflatten(0, model.shape)


def distinct(atoms: Tensor, limit: float) -> Tensor:
    """Indices of atoms `[J, D]` that no earlier kept one resembles, in their order."""
    alike = (atoms @ atoms.T > limit).cpu().triu(1)
    kept = torch.ones(len(atoms), dtype=torch.bool)
    for row in range(len(atoms)):
        if kept[row]:
            kept &= ~alike[row]
    return torch.nonzero(kept).squeeze(1).to(atoms.device)
