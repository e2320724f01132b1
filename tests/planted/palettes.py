"""Flat textures of a few mixtures, strewn over the texels."""

from __future__ import annotations

import torch
from torch import Tensor

from spmm_torch import BTF
from spmm_torch.geometry.directions import ring_directions
from spmm_torch.lobes.batch import COORDINATES, LobeBatch, decode

from .btfs import texel_btf
from .lobes import HORIZON


def strewn_palettes(
    side: int, palettes: int, seed: int, directions: Tensor | None = None
) -> tuple[BTF, float]:
    """A BTF made of known mixtures, 1 to 4 lobes of any model a texel, and their mean number.

    Each palette is a mixture of its own; texels of a palette differ in all weights and colours.
    """
    generator = torch.Generator().manual_seed(seed)
    directions = ring_directions() if directions is None else directions
    texels = side * side
    palette = torch.randint(palettes, (texels,), generator=generator)
    count = torch.randint(1, 5, (palettes,), generator=generator)
    values = torch.zeros(texels, len(directions) ** 2, 3)
    for index in range(palettes):
        lobes = _random_lobes(int(count[index]), generator)
        rho = lobes.eval_grid(directions, directions)
        rho = rho / rho.norm(dim=1, keepdim=True)
        own = torch.nonzero(palette == index).squeeze(1)
        weights = 0.1 + 0.9 * torch.rand(len(own), len(lobes), 3, generator=generator)
        values[own] = torch.einsum("njc,jd->ndc", weights, 10.0 * rho)
    btf = texel_btf(values, directions, height=side, name=f"planted{seed}")
    return btf, float(count[palette].float().mean())


def _random_lobes(count: int, generator: torch.Generator) -> LobeBatch:
    """Lobes of any of the seven models, tilted up to 45 degrees, neither flat nor needles.

    They fade at their horizons as those of a fit do.
    """
    model = torch.randint(7, (count,), generator=generator)
    coordinates = torch.rand(count, COORDINATES, generator=generator)
    coordinates[:, :2] -= 0.5
    coordinates[:, 2] *= torch.pi
    coordinates[:, 3:] = 0.25 + 0.5 * coordinates[:, 3:]
    return decode(model, coordinates, HORIZON)
