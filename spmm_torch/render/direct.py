"""Direct light: radiance that a hit reflects to the eye."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from .environment import EnvironmentLight
from .lights import DirectionalLight, PointLight
from .material import Material, SampledMaterial

# Directions that are evaluated at once: some hundred MB, with what a material allocates.
BLOCK_DIRECTIONS = 1 << 19


@dataclass(frozen=True)
class Hits:
    """The points where N eye rays meet the shape.

    Attributes:
        position: in world axes, `[N, 3]`.
        frame: local frames, rows tangent, bitangent and normal, `[N, 3, 3]`.
        uv: texture coordinates `[N, 2]`.
        wo: local directions to the eye, `[N, 3]`.
        pixel: row * size + column, `[N]`.
        sample: number of the eye ray within its pixel, `[N]`.
    """

    position: Tensor
    frame: Tensor
    uv: Tensor
    wo: Tensor
    pixel: Tensor
    sample: Tensor

    def __len__(self) -> int:
        return len(self.pixel)

    def __getitem__(self, index: Tensor | slice) -> Hits:
        """The hits at `index`."""
        parts = (self.position, self.frame, self.uv, self.wo, self.pixel, self.sample)
        return Hits(*(part[index] for part in parts))

    def local(self, direction: Tensor) -> Tensor:
        """World directions `[N, n, 3]` in the frame of each hit."""
        return direction @ self.frame.transpose(1, 2)

    def world(self, direction: Tensor) -> Tensor:
        """Local directions `[N, n, 3]` in world axes."""
        return direction @ self.frame


def from_delta_lights(
    material: Material, hits: Hits, lights: Sequence[DirectionalLight | PointLight]
) -> Tensor:
    """Exact radiance `[N, 3]` from lights with one direction each."""
    wi, irradiance = delta_light_directions(hits, lights)
    return (lit_values(material, hits, wi) * irradiance).sum(1)


def delta_light_directions(
    hits: Hits, lights: Sequence[DirectionalLight | PointLight]
) -> tuple[Tensor, Tensor]:
    """Local directions to L lights and irradiance facing them, both `[N, L, 3]`."""
    towards, irradiance = zip(*(light.at(hits.position) for light in lights), strict=True)
    return hits.local(torch.stack(towards, dim=1)), torch.stack(irradiance, dim=1)


def from_environment(
    material: SampledMaterial, hits: Hits, light: EnvironmentLight, u: tuple[Tensor, Tensor]
) -> Tensor:
    """An unbiased estimate of the radiance `[N, 3]` from an environment.

    Half of the directions are sampled by the light, half by the material; each is divided by the
    sum of both densities [Veach and Guibas 1995, balance heuristic].

    Args:
        u: random numbers for the light `[N, n, 2]` and for the material `[N, n, 3]`.
    """
    direction, radiance, light_pdf = light.sample(u[0])
    wi = hits.local(direction)
    uv, wo = (x[:, None].expand(-1, wi.shape[1], -1) for x in (hits.uv, hits.wo))
    density = light_pdf + material.pdf(uv, wi, wo)
    of_light = weighted(lit_values(material, hits, wi) * radiance, density)
    wi, value, density = material.sample(uv, wo, u[1])
    direction = hits.world(wi)
    of_material = weighted(
        value * light.radiance(direction), density + light.pdf(direction), wi[..., 2] > 0.0
    )
    return (of_light + of_material).mean(1)


def weighted(value: Tensor, density: Tensor, counts: Tensor | None = None) -> Tensor:
    """value `[..., 3]` / density `[...]`; 0 where the density is 0 or `counts` is False."""
    counts = density > 0.0 if counts is None else counts & (density > 0.0)
    return torch.where(counts[..., None], value / torch.where(counts, density, 1.0)[..., None], 0.0)


def lit_values(material: Material, hits: Hits, wi: Tensor) -> Tensor:
    """Values of the material `[N, n, 3]` at local wi `[N, n, 3]`; 0 below the horizon."""
    hit, number = torch.nonzero(wi[..., 2] > 0.0, as_tuple=True)
    value = torch.zeros_like(wi)
    value[hit, number] = material(hits.uv[hit], wi[hit, number], hits.wo[hit])
    return value
