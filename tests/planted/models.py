"""Models of random lobes and weights."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import cycle, islice

import torch
from torch import Tensor

from spmm_torch import SPMM
from spmm_torch.brdf import MODEL_NAMES
from spmm_torch.edit.parts import with_parts
from spmm_torch.geometry.directions import REPEAT, UBO2003_RINGS, ring_directions
from spmm_torch.model.components import Components, encode_coefficients, encode_functions
from spmm_torch.model.lookup import SparseWeights
from spmm_torch.model.relief import Relief
from spmm_torch.model.residual import Residual, encode_residual
from tests.planted.lobes import random_lobes

# By name: a BRDF that is new does not change what is planted.
DIFFUSE = ("lambertian", "oren_nayar")
GLOSSY = ("blinn_phong", "ward", "cook_torrance", "lafortune", "ashikhmin_shirley")
# Rings half as far apart as those of UBO2003, and further down; and few ones.
FINE_RINGS = ((0.0, 1),) + tuple((7.5 * n, max(8, round(48 * n / 10))) for n in range(1, 12))
FEW_RINGS = ((0.0, 1), (30.0, 6), (60.0, 10))


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
    texels, count = size * size, len(directions)
    drawn = tuple(islice(cycle(names), clusters * lobes_per_cluster))
    lobes = random_lobes(drawn, generator, tilt=0.15, low=0.35, high=0.65)
    labels = (torch.arange(texels) % size) * clusters // size
    order = torch.rand(texels, lobes_per_cluster, generator=generator).argsort(dim=1)
    index = order[:, :lobes_per_texel].sort(dim=1).values + labels[:, None] * lobes_per_cluster
    weight = torch.rand(index.numel(), 3, generator=generator)
    code = residual * torch.randn(clusters, count, count, 3, generator=generator)
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


def uneven_model(
    counts: Sequence[int],
    height: int,
    light: Tensor,
    view: Tensor,
    clusters: int = 2,
    names: tuple[str, ...] = MODEL_NAMES,
    precision: torch.dtype = torch.float16,
    name: str = "planted",
) -> SPMM:
    """A model whose texels have `counts [T]` lobes, out of one of each BRDF of `names`."""
    generator = torch.Generator().manual_seed(5)
    lobes = random_lobes(names, generator)
    index = [torch.randperm(len(names), generator=generator)[:count] for count in counts]
    weight = torch.rand(sum(counts), 3, generator=generator)
    values = 0.1 * torch.rand(clusters, len(view), len(light), 3, generator=generator)
    return SPMM(
        height,
        len(counts) // height,
        lobes,
        SparseWeights(torch.tensor([0, *counts]).cumsum(0), torch.cat(index), weight),
        torch.arange(len(counts)) % clusters,
        Residual(*encode_residual(values, precision), light, view),
        light,
        view.clone(),  # safetensors stores no tensor twice
        name,
    )


def with_components(
    model: SPMM,
    rank: int = 3,
    size: float = 0.05,
    beside: bool = False,
    dtype: torch.dtype = torch.int8,
) -> SPMM:
    """The model with a residual of rank R, each component half as large as the one before.

    Args:
        model: gives all else.
        rank: R.
        size: standard deviation of the first component.
        beside: whether the residual of clusters stays; it goes otherwise.
        dtype: of the codes of the functions.
    """
    generator = torch.Generator().manual_seed(12)
    light, view = model.light, model.view
    decay = size * 0.5 ** torch.arange(rank)
    shape = (rank, len(view), len(light), model.weight.shape[1])
    functions = decay.view(-1, 1, 1, 1) * torch.randn(shape, generator=generator)
    coefficients = torch.randn(model.texel_count, rank, generator=generator)
    coded = *encode_functions(functions, dtype), *encode_coefficients(coefficients)
    residual = model.residual
    if not beside:
        residual = residual.with_codes(residual.code.detach()[:0], residual.scale[:0])
    return with_parts(model, residual=residual, components=Components(*coded, light, view))


def planted_relief(
    height: int, width: int, depth: float = 0.1, rule: str = REPEAT, drift: Tensor | None = None
) -> Relief:
    """A smooth relief of H x W texels, `depth` texture widths from its valleys to its peaks.

    Its mean plane lies a fifth of that over the plane of the pictures.
    """
    row, column = (torch.arange(n) * (2.0 * torch.pi / n) for n in (height, width))
    bumps = torch.sin(column) + torch.cos(row[:, None] + column) + torch.sin(2.0 * row[:, None])
    bumps = (bumps - bumps.min()) / (bumps.max() - bumps.min())
    return Relief.of_heights(depth * (bumps - bumps.mean() + 0.2).flatten(), rule, drift)


def with_relief(model: SPMM, relief: Relief | None = None) -> SPMM:
    """The same model over a relief; that of `planted_relief` by default."""
    return with_parts(model, relief=relief or planted_relief(model.height, model.width))


def with_residual(size: int, rings: tuple[tuple[float, int], ...] = FEW_RINGS) -> SPMM:
    """A model of size x size texels with three lobes each and a residual that is not negative."""
    directions = ring_directions(rings)
    return uneven_model([3] * size**2, size, directions, directions)


@torch.no_grad()
def measured_values(model: SPMM, residual: bool = True) -> Tensor:
    """The values `[T, D, C]` of a model at its own direction pairs, picture by picture."""
    pictures = [model.picture(wi, wo, residual) for wo in model.view for wi in model.light]
    return torch.stack(pictures).flatten(1, 2).transpose(0, 1)
