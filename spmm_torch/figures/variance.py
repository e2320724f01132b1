"""Efficiency of a sampler: variance and time of its estimates of the reflected light."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from ..render import EnvironmentLight
from ..render.direct import BLOCK_DIRECTIONS, Hits, weighted
from ..render.material import SampledMaterial
from ..runtime.memory import slices

# Rows of the map of a uniform light.
WHITE_ROWS = 8


@dataclass(frozen=True)
class Efficiency:
    """The efficiency of a sampler.

    Attributes:
        variance: of one sample, the mean over hits and channels.
        seconds: of one sample.
    """

    variance: float
    seconds: float


@dataclass(frozen=True)
class Gain:
    """The factor between the variances of two samplers, at equal count and at equal time."""

    equal_count: float
    equal_time: float


def white_light() -> EnvironmentLight:
    """Radiance 1 from everywhere, so that only the material varies."""
    return EnvironmentLight.build(torch.ones(WHITE_ROWS, 2 * WHITE_ROWS, 3))


def estimates(material: SampledMaterial, hits: Hits, light: EnvironmentLight, u: Tensor) -> Tensor:
    """Unbiased estimates `[N, n, 3]` of the radiance to the eye by the material's sampler alone.

    Args:
        material: with its sampler.
        hits: where eye rays meet the shape.
        light: that is reflected.
        u: random numbers `[N, n, 3]`.
    """
    uv, wo = (x[:, None].expand(-1, u.shape[1], -1) for x in (hits.uv, hits.wo))
    wi, value, density = material.sample(uv, wo, u)
    direction = hits.world(wi)
    return weighted(value * light.radiance(direction), density, wi[..., 2] > 0.0)


@torch.no_grad()
def shade_by_sampler(
    material: SampledMaterial, hits: Hits, light: EnvironmentLight, each: int, seed: int
) -> tuple[Tensor, Efficiency]:
    """The mean of `each` estimates of every hit `[N, 3]`, and their efficiency.

    Seconds count sampling and evaluation without drawing the random numbers. The variance of a
    single estimate is NaN.
    """
    generator = torch.Generator().manual_seed(seed)
    means, variances, seconds = [], [], 0.0
    for block in slices(len(hits), max(1, BLOCK_DIRECTIONS // each)):
        part = hits[block]
        u = torch.rand(len(part), each, 3, generator=generator).to(hits.uv)
        _wait(hits.uv.device)
        start = time.perf_counter()
        value = estimates(material, part, light, u)
        _wait(hits.uv.device)
        seconds += time.perf_counter() - start
        means.append(value.mean(1))
        if each > 1:
            variances.append(value.double().var(1))
    variance = float(torch.cat(variances).mean()) if variances else float("nan")
    return torch.cat(means), Efficiency(variance, seconds / (len(hits) * each))


def gain(ours: Efficiency, other: Efficiency) -> Gain:
    """The gain of our sampler: variance falls with the number of samples, and so with time."""
    equal_count = other.variance / ours.variance if ours.variance > 0.0 else float("inf")
    return Gain(equal_count, equal_count * other.seconds / ours.seconds)


def some_hits(hits: Hits, count: int, seed: int) -> Hits:
    """`count` of the hits at random, or all if they are fewer."""
    order = torch.randperm(len(hits), generator=torch.Generator().manual_seed(seed))
    return hits[order[:count].to(hits.uv.device)]


def hits_at(uv: Tensor, wo: Tensor) -> Hits:
    """A hit of a flat surface at uv `[2]`, seen from wo `[3]`."""
    frame = torch.eye(3, dtype=wo.dtype, device=wo.device)[None]
    zero = torch.zeros(1, dtype=torch.long, device=wo.device)
    return Hits(torch.zeros_like(wo)[None], frame, uv[None], wo[None], zero, zero)


def repeated(hits: Hits, count: int) -> Hits:
    """The hits, each repeated `count` times."""
    index = torch.arange(len(hits), device=hits.uv.device).repeat_interleave(count)
    return replace(hits[index])


def _wait(device: torch.device) -> None:
    if device.type == "cuda":
        torch.cuda.synchronize(device)
