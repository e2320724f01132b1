"""Materials that are known exactly, and hits to try them on."""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor

from spmm_torch import BTF, SPMM
from spmm_torch.brdf import MODEL_NAMES
from spmm_torch.geometry.directions import UBO2003_RINGS, direction_from_angles, ring_directions
from spmm_torch.geometry.warp import square_to_power_cosine, square_to_power_cosine_pdf
from spmm_torch.lobes.batch import COORDINATES, decode
from spmm_torch.model.residual import Residual
from spmm_torch.model.spmm import SparseWeights
from spmm_torch.render.direct import Hits

# By name: a BRDF that is new does not change what is planted.
DIFFUSE = ("lambertian", "oren_nayar")
GLOSSY = ("blinn_phong", "ward", "cook_torrance", "lafortune", "ashikhmin_shirley")
# Rings half as far apart as those of UBO2003, and further down.
FINE_RINGS = ((0.0, 1),) + tuple((7.5 * n, max(8, round(48 * n / 10))) for n in range(1, 12))


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


def planted_model(
    size: int = 8,
    lobes_per_texel: int = 3,
    clusters: int = 2,
    lobes_per_cluster: int = 6,
    rings: tuple[tuple[float, int], ...] = UBO2003_RINGS,
    residual: float = 0.0,
    names: tuple[str, ...] = DIFFUSE + GLOSSY,
    seed: int = 3,
) -> SPMM:
    """A model of size x size texels in vertical stripes of clusters, with random lobes.

    Args:
        residual: standard deviation of its values.
        names: of the BRDFs, in turn.
    """
    generator = torch.Generator().manual_seed(seed)
    directions = ring_directions(rings)
    texels, lobe_count = size * size, clusters * lobes_per_cluster
    coordinates = 0.35 + 0.3 * torch.rand(lobe_count, COORDINATES, generator=generator)
    coordinates[:, :2] = 0.5 * (coordinates[:, :2] - 0.5)
    model = torch.tensor([MODEL_NAMES.index(name) for name in names])
    lobes = decode(model[torch.arange(lobe_count) % len(names)], coordinates)
    labels = (torch.arange(texels) % size) * clusters // size
    order = torch.rand(texels, lobes_per_cluster, generator=generator).argsort(dim=1)
    index = order[:, :lobes_per_texel].sort(dim=1).values + labels[:, None] * lobes_per_cluster
    weight = torch.rand(index.numel(), 3, generator=generator)
    code = residual * torch.randn(
        clusters, len(directions), len(directions), 3, generator=generator
    )
    return SPMM(
        size,
        size,
        lobes,
        SparseWeights(torch.arange(texels + 1) * lobes_per_texel, index.flatten(), weight),
        labels,
        Residual(code, torch.ones(clusters), directions, directions),
        directions,
        directions.clone(),  # safetensors stores no tensor twice
        "planted",
    )


def tabulated(model: SPMM) -> BTF:
    """The BTF of a model without residual at its own directions."""
    with torch.no_grad():
        rho = model.dictionary.eval_grid(model.light, model.view)  # [J, D]
        texel = torch.repeat_interleave(model.lobe_count_per_texel())
        values = torch.zeros(model.texel_count, rho.shape[1], 3)
        entries = model.weight[:, None] * rho[model.index, :, None]
        values.index_add_(0, texel, entries)
    pairs = (len(model.view), len(model.light))
    pictures = values.unflatten(1, pairs).unflatten(0, (model.height, model.width))
    return BTF.from_values(pictures.permute(2, 3, 0, 1, 4), model.view, model.light)


def hits_of(count: int, seed: int) -> Hits:
    """Hits in the middle of a plane, seen from random directions."""
    generator = torch.Generator().manual_seed(seed)
    theta = 1.2 * torch.rand(count, generator=generator)
    wo = direction_from_angles(theta, 2.0 * math.pi * torch.rand(count, generator=generator))
    number = torch.arange(count)
    uv = torch.rand(count, 2, generator=generator)
    frame = torch.eye(3).expand(count, 3, 3)
    return Hits(torch.zeros(count, 3), frame, uv, wo, number, torch.zeros_like(number))
