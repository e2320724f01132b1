"""BTFs of a known relief: textured heights, drawn by a march along each view's rays."""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor

from spmm_torch import BTF
from spmm_torch.geometry.directions import ring_directions

RINGS = ((0.0, 1), (15.0, 6), (30.0, 10), (45.0, 12), (60.0, 14))
LIGHT_RINGS = ((20.0, 3), (50.0, 5))
# Places along a ray: its steps are under a tenth of a texel in these reliefs.
MARCH = 192


@dataclass(frozen=True)
class PlantedRelief:
    """A BTF and what it was made of.

    Attributes:
        btf: the BTF.
        height: heights `[H, W]` in texture widths.
        drift: shift of each view in columns and rows, `[V, 2]`.
    """

    btf: BTF
    height: Tensor
    drift: Tensor


def smooth_noise(size: tuple[int, int], wavelength: float, generator: torch.Generator) -> Tensor:
    """Periodic noise `[H, W]` of mean 0 and variance 1 without waves under `wavelength` texels."""
    spectrum = torch.fft.fft2(torch.randn(size, generator=generator))
    row, column = (torch.fft.fftfreq(side) for side in size)
    frequency = (row[:, None].square() + column.square()).sqrt()
    kept = torch.exp(-0.5 * (frequency * wavelength).square() * 2.0)
    noise = torch.fft.ifft2(spectrum * kept).real
    return (noise - noise.mean()) / noise.std()


def planted_relief(
    depth: float = 0.02,
    plane: float = 0.03,
    drift: Tensor | None = None,
    *,
    size: tuple[int, int] = (48, 48),
    texture: float = 0.5,
    noise: float = 0.01,
    periodic: bool = True,
    views: Tensor | None = None,
    lights: Tensor | None = None,
    seed: int = 0,
) -> PlantedRelief:
    """A textured relief under matt and glossy light, without shadows.

    Args:
        depth: standard deviation of the heights, in texture widths.
        plane: their mean.
        drift: shift of each view, in columns and rows, `[V, 2]`; None: none.
        size: rows and columns of the pictures.
        texture: standard deviation of the logarithm of the albedo.
        noise: standard deviation of the noise of values, relative to them.
        periodic: whether the texture repeats; else it is a part of a larger one.
        views, lights: unit vectors `[V, 3]`, `[L, 3]`; None: rings.
        seed: seed of all that is random.
    """
    generator = torch.Generator().manual_seed(seed)
    view = ring_directions(RINGS) if views is None else views
    light = ring_directions(LIGHT_RINGS) if lights is None else lights
    whole = size if periodic else (2 * size[0], 2 * size[1])
    height = plane + depth * smooth_noise(whole, 12.0, generator)
    albedo = 0.2 * (texture * smooth_noise(whole, 2.5, generator)).exp()
    drift = torch.zeros(len(view), 2) if drift is None else drift
    shown = [
        _shown(height, size, direction, shift) for direction, shift in zip(view, drift, strict=True)
    ]
    values = torch.stack(
        [
            _shaded(height, albedo, place, size[1], direction, light)
            for place, direction in zip(shown, view, strict=True)
        ]
    )  # [V, L, H, W]
    values = values * (1.0 + noise * torch.randn(values.shape, generator=generator))
    colour = torch.tensor([1.0, 0.8, 0.6])
    btf = BTF.from_values(values.clamp(min=0.0)[..., None] * colour, view, light)
    return PlantedRelief(btf, height[: size[0], : size[1]], drift)


def _shown(
    height: Tensor, size: tuple[int, int], view: Tensor, drift: Tensor
) -> tuple[Tensor, Tensor]:
    """Columns and rows `[H, W]` of what a view shows, by a march from the highest point down."""
    row, column = torch.meshgrid(*map(torch.arange, size), indexing="ij")
    across, down = (float(part / view[2]) * size[1] for part in (view[0], -view[1]))
    level = torch.linspace(float(height.max()), float(height.min()), MARCH)[:, None, None]
    x = column - drift[0] + level * across  # [N, H, W]
    y = row - drift[1] + level * down
    inside = level <= read(height, x, y)
    inside[-1] = True
    first = inside.float().argmax(0, keepdim=True)
    return x.gather(0, first)[0], y.gather(0, first)[0]


def _shaded(
    height: Tensor,
    albedo: Tensor,
    place: tuple[Tensor, Tensor],
    width: int,
    view: Tensor,
    light: Tensor,
) -> Tensor:
    """Values `[L, H, W]` of a matt and glossy surface at the places that a view shows."""
    across = 0.5 * width * (height.roll(-1, 1) - height.roll(1, 1))
    down = 0.5 * width * (height.roll(-1, 0) - height.roll(1, 0))
    normal = torch.stack((-across, down, torch.ones_like(height)))
    normal = torch.stack([read(part, *place) for part in normal / normal.norm(dim=0)])
    half = light + view
    half = half / half.norm(dim=1, keepdim=True)
    matt = torch.einsum("li,ihw->lhw", light, normal).clamp(min=0.0)
    gloss = torch.einsum("li,ihw->lhw", half, normal).clamp(min=0.0) ** 12.0
    return matt * (read(albedo, *place) / math.pi * 2.0 + 0.1 * gloss) + 1e-3


def read(picture: Tensor, column: Tensor, row: Tensor) -> Tensor:
    """A periodic `picture [H, W]` at places `[...]`, bilinear."""
    left, top = column.floor(), row.floor()
    right, bottom = column - left, row - top
    rows, columns = picture.shape
    total = torch.zeros_like(column)
    for down, across in ((0, 0), (0, 1), (1, 0), (1, 1)):
        weight = (bottom if down else 1.0 - bottom) * (right if across else 1.0 - right)
        index = ((top.long() + down) % rows, (left.long() + across) % columns)
        total = total + weight * picture[index]
    return total
