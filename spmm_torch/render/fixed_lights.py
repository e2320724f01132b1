"""Environments as a few fixed directions, the same for all pixels: pictures without noise.

Each direction stands for a cell of the environment, its power and its middle [Deb05], so the
sum over cells is exact for what varies linearly within them. The cells of a picture are shared out
among the eye rays of a pixel.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from .direct import Hits, lit_values
from .environment import EnvironmentLight
from .material import Material

# Steps towards cells whose middles stay [Llo82]; pictures hardly change after them.
STEPS = 20
# Points of a map that are sorted into cells.
MAP_POINTS = 1 << 14


@dataclass(frozen=True)
class FixedLights:
    """Directions and irradiance of some environments, for each of the eye rays of a pixel.

    Attributes:
        direction: unit, towards the lights, in world axes, `[samples, n, 3]`.
        irradiance: RGB facing each of them, `[samples, n, 3]`; its mean over the eye rays lights a
            pixel.
    """

    direction: Tensor
    irradiance: Tensor

    @classmethod
    def build(cls, lights: Sequence[EnvironmentLight], samples: int, each: int) -> FixedLights:
        """`each` directions of each light for each of `samples` eye rays of a pixel."""
        parts = [_shared_out(*cells(light, samples * each), samples) for light in lights]
        direction, irradiance = (torch.cat(part, dim=1) for part in zip(*parts, strict=True))
        return cls(direction, irradiance * samples)

    @property
    def together(self) -> FixedLights:
        """All directions for one eye ray, `[1, samples * n, 3]`."""
        samples = len(self.direction)
        direction, irradiance = (
            part.flatten(0, 1)[None] for part in (self.direction, self.irradiance / samples)
        )
        return FixedLights(direction, irradiance)

    def to(self, like: Tensor) -> FixedLights:
        """The same lights on the device and in the dtype of a tensor `[...]`."""
        return FixedLights(self.direction.to(like), self.irradiance.to(like))


def from_fixed_lights(material: Material, hits: Hits, lights: FixedLights) -> Tensor:
    """Radiance `[N, 3]` that hits reflect to the eye."""
    wi = hits.local(lights.direction[hits.sample])
    return (lit_values(material, hits, wi) * lights.irradiance[hits.sample]).sum(1)


def cells(light: EnvironmentLight, count: int) -> tuple[Tensor, Tensor]:
    """(middles `[count, 3]`, power `[count, 3]`) of cells of an environment, float64.

    Middles are unit vectors in world axes; power is RGB irradiance on a surface that faces them.
    """
    direction, power = light.points(MAP_POINTS)
    luminance = light.luminance(power)[:, None]
    points = torch.quasirandom.SobolEngine(2).draw(count, dtype=torch.float64) + 0.5 / count
    middle = light.sample(points.to(power.device))[0]
    for _ in range(STEPS):
        cell = (direction @ middle.T).argmax(1)
        total = torch.zeros_like(middle).index_add_(0, cell, direction * luminance)
        length = total.norm(dim=1, keepdim=True)
        # A cell without power keeps its place.
        middle = torch.where(length > 0.0, total / length.clamp(min=1e-300), middle)
    cell = (direction @ middle.T).argmax(1)
    return middle, torch.zeros_like(middle).index_add_(0, cell, power)


def _shared_out(direction: Tensor, power: Tensor, samples: int) -> tuple[Tensor, Tensor]:
    """Cells `[samples * n, 3]` as `[samples, n, 3]`, of about equal power for each eye ray."""
    order = power.sum(1).argsort(descending=True, stable=True).view(-1, samples)
    order[1::2] = order[1::2].flip(1)  # to and fro, so that the sums are alike
    return direction[order.T], power[order.T]
