"""The random numbers of a picture: stratified points of pixels, and shifted Sobol points."""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor

LIGHT_NUMBERS, MATERIAL_NUMBERS = 2, 3


def pixel_points(
    pixel: Tensor, size: int, samples: int, generator: torch.Generator | None = None
) -> Tensor:
    """One point in each stratum of each pixel: `[N, samples, 2]`, rightwards and up.

    Args:
        pixel: row * size + column of N pixels, row 0 at the top.
        size: pixels along each side of the picture, which spans 0 to 1.
        samples: strata of a pixel, as nearly square as their number allows.
        generator: of random points, on the CPU; None: the middles of the strata.
    """
    down = max(n for n in range(1, math.isqrt(samples) + 1) if samples % n == 0)
    across = samples // down
    jitter = torch.full((len(pixel), samples, 2), 0.5)
    if generator is not None:
        jitter = torch.rand(jitter.shape, generator=generator)
    jitter = jitter.to(pixel.device)
    stratum = torch.arange(samples, device=pixel.device)
    x = (pixel % size)[:, None] + (stratum % across + jitter[..., 0]) / across
    y = torch.div(pixel, size, rounding_mode="floor")[:, None]
    y = y + (torch.div(stratum, across, rounding_mode="floor") + jitter[..., 1]) / down
    return torch.stack((x / size, 1.0 - y / size), dim=-1)


@dataclass(frozen=True)
class LightNumbers:
    """Numbers in [0, 1) that choose lights and directions.

    All pixels have the same Sobol points, shifted by a random vector [Cranley and Patterson 1976].

    Attributes:
        points: Sobol points of a pixel, `[samples, n, 5]`.
        shift: of each pixel, `[P, 5]`.
    """

    points: Tensor
    shift: Tensor

    @classmethod
    def draw(cls, pixels: int, samples: int, each: int, generator: torch.Generator) -> LightNumbers:
        """`each` points for each of `samples` eye rays of P pixels."""
        numbers = LIGHT_NUMBERS + MATERIAL_NUMBERS
        points = torch.quasirandom.SobolEngine(numbers).draw(samples * each)
        shift = torch.rand(pixels, numbers, generator=generator)
        return cls(points.view(samples, each, numbers), shift)

    def to(self, device: torch.device | str) -> LightNumbers:
        """The same numbers on another device."""
        return LightNumbers(self.points.to(device), self.shift.to(device))

    def of(self, pixel: Tensor, sample: Tensor) -> tuple[Tensor, Tensor]:
        """The numbers of N eye rays: for lights `[N, n, 2]`, for materials `[N, n, 3]`."""
        moved = self.points[sample] + self.shift[pixel][:, None]
        u = moved - torch.floor(moved)
        return u[..., :LIGHT_NUMBERS], u[..., LIGHT_NUMBERS:]
