"""Materials whose integrals are known, and hits to try them on."""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor

from spmm_torch.geometry.directions import direction_from_angles
from spmm_torch.geometry.warp import square_to_power_cosine, square_to_power_cosine_pdf
from spmm_torch.render.direct import Hits


@dataclass(frozen=True)
class Lambertian:
    """A diffuse material."""

    albedo: tuple[float, float, float] = (1.0, 1.0, 1.0)

    def __call__(self, uv: Tensor, wi: Tensor, wo: Tensor) -> Tensor:
        """albedo / pi times the cosine."""
        lit = wi[..., 2].clamp(min=0.0) * (wo[..., 2] > 0.0)
        return lit[..., None] * torch.tensor(self.albedo).to(wi) / math.pi


@dataclass(frozen=True)
class Shiny:
    """Diffuse, with a highlight about the normal that its sampler knows."""

    exponent: float = 40.0

    def __call__(self, uv: Tensor, wi: Tensor, wo: Tensor) -> Tensor:
        """Grey, cosine-weighted."""
        z = wi[..., 2].clamp(min=0.0)
        value = (0.2 * z + 2.0 * z**self.exponent) * (wo[..., 2] > 0.0)
        return value[..., None].expand(*value.shape, 3)

    def sample(self, uv: Tensor, wo: Tensor, u: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Half of the directions by the highlight, half by the cosine."""
        exponent = torch.where(u[..., 0] < 0.5, 1.0, self.exponent)
        wi = square_to_power_cosine(u[..., 1:], exponent)
        return wi, self(uv, wi, wo), self.pdf(uv, wi, wo)

    def pdf(self, uv: Tensor, wi: Tensor, wo: Tensor) -> Tensor:
        """Of `sample`."""
        exponents = (torch.tensor(n).to(wi) for n in (1.0, self.exponent))
        return 0.5 * sum(square_to_power_cosine_pdf(wi, exponent) for exponent in exponents)


def hits_of(count: int, seed: int) -> Hits:
    """Hits in the middle of a plane, seen from random directions."""
    generator = torch.Generator().manual_seed(seed)
    theta = 1.2 * torch.rand(count, generator=generator)
    wo = direction_from_angles(theta, 2.0 * math.pi * torch.rand(count, generator=generator))
    number = torch.arange(count)
    uv = torch.rand(count, 2, generator=generator)
    frame = torch.eye(3).expand(count, 3, 3)
    return Hits(torch.zeros(count, 3), frame, uv, wo, number, torch.zeros_like(number))
