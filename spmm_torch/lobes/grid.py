"""Lobes evaluated on the measured direction pairs."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property

import torch
from torch import Tensor

from ..geometry.directions import angular_spacing, half_vectors
from ..geometry.neighbours import nearest
from .batch import LobeBatch, decode, decoded, in_one_block, together
from .jacobian import Directions, linearize
from .ragged import Grouped, Spans
from .values import eval_models

# Two lobes whose values correlate more than this count as the same lobe.
SAME_LOBE = 0.999
# Samples of a list that see the peak of the narrowest lobe, which by default (`search.min_width`)
# is a quarter of the spacing.
SEEN_BY, NARROWEST = 4, 0.25


@dataclass(frozen=True)
class DirectionGrid:
    """All pairs of L lights and V views, d = view * L + light; or a list of D pairs.

    Attributes:
        light: `[1, 1, L, 3]`, of a list `[1, 1, D, 3]`.
        view: `[1, V, 1, 3]`, of a list `[1, 1, D, 3]`.
        scale: factor of all values, the square root of the weight of each pair, `[D]`; None: 1.
        horizon: of the lobes that `decode` gives, as in `LobeBatch`.
    """

    light: Tensor
    view: Tensor
    scale: Tensor | None = None
    horizon: float = 0.0

    @classmethod
    def build(
        cls,
        light: Tensor,
        view: Tensor,
        device: torch.device,
        scale: Tensor | None = None,
        horizon: float = 0.0,
    ) -> DirectionGrid:
        """The grid of lights `[L, 3]` and views `[V, 3]`, scaled by `scale [D]`."""
        scale = None if scale is None else scale.to(device)
        return cls(light.to(device)[None, None], view.to(device)[None, :, None], scale, horizon)

    @classmethod
    def of_pairs(
        cls,
        wi: Tensor,
        wo: Tensor,
        device: torch.device,
        scale: Tensor | None = None,
        horizon: float = 0.0,
    ) -> DirectionGrid:
        """The list of the pairs of lights `[D, 3]` and views `[D, 3]`, scaled by `scale [D]`."""
        scale = None if scale is None else scale.to(device)
        return cls(wi.to(device)[None, None], wo.to(device)[None, None], scale, horizon)

    @property
    def is_list(self) -> bool:
        """Whether each light has a view of its own."""
        return self.view.shape[2] > 1

    def part(self, pairs: slice) -> DirectionGrid:
        """Some consecutive pairs of a list."""
        scale = None if self.scale is None else self.scale[pairs]
        return replace(
            self, light=self.light[:, :, pairs], view=self.view[:, :, pairs], scale=scale
        )

    @cached_property
    def _directions(self) -> Directions:
        """The pairs, with what is the same of them for all lobes."""
        return Directions(self.light, self.view)

    @property
    def unscaled(self) -> DirectionGrid:
        """The same pairs without their weights."""
        return replace(self, scale=None)

    @property
    def pair_count(self) -> int:
        """D."""
        return self.light.shape[2] * self.view.shape[1]

    @property
    def spacing(self) -> float:
        """The smaller of the angles between neighbouring lights and neighbouring views.

        That of a list is such that a quarter of it reaches from half vectors to their 4th
        neighbours: a lobe of this width is seen by so many samples.
        """
        if self.is_list:
            return self._spacing_of_list()
        sets = self.light[0, 0], self.view[0, :, 0]
        return min(angular_spacing(directions.cpu()) for directions in sets)

    def _spacing_of_list(self) -> float:
        """Median over all half vectors, at most pi / 2."""
        half = half_vectors(self.light[0, 0], self.view[0, 0])
        count = min(SEEN_BY + 1, len(half))  # with itself
        chord = nearest(half, half, count)[0][:, -1].median()
        angle = 2.0 * math.asin(min(1.0, 0.5 * float(chord)))
        return min(angle / NARROWEST, 0.5 * math.pi)

    def decode(self, model: Tensor, coordinates: Tensor) -> LobeBatch:
        """Lobes of `model [J]` at search coordinates `[J, COORDINATES]`, with this horizon."""
        return decode(model, coordinates, self.horizon)

    def eval(self, lobes: LobeBatch) -> Tensor:
        """Values of lobes on all pairs, `[J, D]` [WDR11 Eq. 3]."""
        return self.scaled(lobes.eval(self.light, self.view).flatten(1))

    def eval_at(self, lobes: LobeBatch, pairs: Tensor) -> Tensor:
        """Values `[J, N]` of each lobe on its own pairs, given by their indices `[J, N]`."""
        values = lobes.eval(*self.at(pairs))
        return values if self.scale is None else values * self.scale[pairs]

    def scaled(self, values: Tensor) -> Tensor:
        """Values `[..., D]` times the scale of their pairs."""
        return values if self.scale is None else values * self.scale

    def at(self, pairs: Tensor) -> tuple[Tensor, Tensor]:
        """Directions (wi, wo), both `[..., 3]`, of pair indices `[...]`."""
        if self.is_list:
            return self.light[0, 0][pairs], self.view[0, 0][pairs]
        lights = self.light.shape[2]
        light = self.light[0, 0][pairs % lights]
        view = self.view[0, :, 0][torch.div(pairs, lights, rounding_mode="floor")]
        return light, view

    def values(self, model: Tensor, coordinates: Tensor, grouped: Grouped | None = None) -> Tensor:
        """Values `[S, M, D]` of lobes.

        Args:
            model: `[S, M]`.
            coordinates: of the search, `[S, M, P]`.
            grouped: the lobes by model, where that is known.
        """
        flat, place = model.reshape(-1), coordinates.flatten(0, 1)

        def sorted_values(spans: Spans, order: Tensor) -> Tensor:
            parts = decoded(spans, place.index_select(0, order))
            return eval_models(spans, *parts, self.light, self.view, self.horizon)

        if in_one_block(place, len(flat) * self.pair_count):
            values = together(flat, sorted_values, grouped).flatten(1)
            return self.scaled(values).unflatten(0, model.shape)
        return self.eval(self.decode(flat, place)).unflatten(0, model.shape)

    def jacobian(self, model: Tensor, coordinates: Tensor) -> tuple[Tensor, Tensor]:
        """`values`, and their derivatives along all coordinates `[S, M, P, D]`."""
        found = self.linearized(model, coordinates)
        return found[:, :, 0], found[:, :, 1:]

    def linearized(
        self, model: Tensor, coordinates: Tensor, grouped: Grouped | None = None
    ) -> Tensor:
        """Values, then derivatives along all coordinates, in one tensor `[S, M, 1 + P, D]`.

        Args:
            model: `[S, M]`.
            coordinates: `[S, M, P]`.
            grouped: the lobes by model, where that is known.
        """
        scale = self.scale
        if scale is not None:
            scale = scale.view(self.view.shape[1], self.light.shape[2])
        at = model.reshape(-1), coordinates.flatten(0, 1), self._directions
        found = linearize(*at, self.horizon, scale, grouped)
        return found.flatten(2).unflatten(0, model.shape)


def distinct(atoms: Tensor, limit: float) -> Tensor:
    """Ascending indices `[N]` of atoms `[J, D]`, of which no two are alike: the first one stays.

    Args:
        atoms: of unit norm.
        limit: correlation above which two atoms are alike.
    """
    alike = (atoms @ atoms.T > limit).cpu().triu(1)
    kept = torch.ones(len(atoms), dtype=torch.bool)
    for row in range(len(atoms)):
        if kept[row]:
            kept &= ~alike[row]
    return torch.nonzero(kept).squeeze(1).to(atoms.device)
