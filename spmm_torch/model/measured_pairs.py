"""The measured pairs of directions around a query, and what each of them counts there."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from ..geometry.grazing import grazing_fade, lowest_cosine
from ..geometry.hemisphere import HemisphereInterpolation


@dataclass(frozen=True)
class MeasuredPairs:
    """The interpolation between V x L measured pairs, view * L + light.

    Attributes:
        light, view: meshes of the measured directions, L and V.
        lowest_light: z of the lowest measured light; see `lowest_cosine`.
    """

    light: HemisphereInterpolation
    view: HemisphereInterpolation
    lowest_light: float

    @classmethod
    def build(cls, light: Tensor, view: Tensor) -> MeasuredPairs:
        """The interpolation between lights `[L, 3]` and views `[V, 3]`."""
        meshes = (HemisphereInterpolation.build(light), HemisphereInterpolation.build(view))
        return cls(*meshes, lowest_cosine(light))

    def to(self, device: torch.device | str) -> MeasuredPairs:
        """The same interpolation on another device."""
        return MeasuredPairs(self.light.to(device), self.view.to(device), self.lowest_light)

    def around(self, wi: Tensor, wo: Tensor) -> tuple[Tensor, Tensor]:
        """The nine pairs around each query, and their weights, both `[Q, 9]`.

        Lights below the lowest measured one fade with their cosine; all weights are 0 where wi or
        wo is under the horizon.

        Args:
            wi, wo: directions `[Q, 3]`.
        """
        return self._combined(wi, wo, self.light.weights(wi), self.view.weights(wo))

    def around_all(self, wi: Tensor, wo: Tensor) -> tuple[Tensor, Tensor]:
        """`around` by `HemisphereInterpolation.weights_of_all`.

        Args:
            wi, wo: directions `[Q, 3]`.
        """
        lights, views = self.light.weights_of_all(wi), self.view.weights_of_all(wo)
        return self._combined(wi, wo, lights, views)

    def _combined(
        self, wi: Tensor, wo: Tensor, lights: tuple[Tensor, Tensor], views: tuple[Tensor, Tensor]
    ) -> tuple[Tensor, Tensor]:
        """Pairs of three lights and three views, given (index, weight) of both, `[Q, 3]` each."""
        (light, light_weight), (view, view_weight) = lights, views
        fade = grazing_fade(wi[:, 2:], self.lowest_light) * (wo[:, 2:] > 0.0)
        pair = view[:, :, None] * len(self.light.directions) + light[:, None, :]
        weight = view_weight[:, :, None] * (light_weight * fade)[:, None, :]
        return pair.flatten(1), weight.flatten(1)
