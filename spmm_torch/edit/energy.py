"""How much light lobes reflect, for edits that keep their energy.

A lobe's mean over light and view is an integral over its own hemisphere. All lobes are upright
there and share one set of points; only the texel's horizon, which cuts off a part of a tilted
lobe, differs from lobe to lobe.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import lru_cache

import torch
from torch import Tensor

from ..brdf import REGISTRY
from ..geometry.directions import direction_from_angles, frame_from_normal
from ..lobes.batch import CPU_BLOCK, CUDA_BLOCK, LobeBatch
from ..lobes.cut import lit_cosine, view_step

# Directions that average a lobe: they are the same before and after, so errors mostly cancel. The
# fewer the lobes, the more directions each gets, within some hundredths of a second for all.
FEWEST_SAMPLES, MOST_SAMPLES, BUDGET = 256, 4096, 3 << 17
# Part of the views that lie densely about the pole.
CROWDED = 0.125
# Least scale of 1 - cos(theta_o): the narrowest lobes about their normal reflect nothing beyond.
POLE = 1e-3


def energy_factors(before: LobeBatch, after: LobeBatch, changed: Tensor) -> Tensor:
    """Factors on weights `[J]` with which each lobe keeps its mean over all lights and views.

    Args:
        before: J lobes.
        after: one in place of each of them.
        changed: true for each lobe that differs, `[J]`; the factor of others is 1.
    """
    rows = torch.nonzero(changed).squeeze(-1)
    means = [mean_reflection(lobes[rows], sample_count(len(rows))) for lobes in (before, after)]
    lit = (means[0] > 0.0) & (means[1] > 0.0)
    ratio = torch.where(lit, means[0] / torch.where(lit, means[1], 1.0), 1.0)
    return torch.ones_like(before.angle).index_copy(0, rows, ratio)


def sample_count(lobes: int) -> int:
    """Directions for each of `lobes` lobes: a power of two, which fills space most evenly."""
    each = 1 << max(0, (BUDGET // max(1, lobes)).bit_length() - 1)
    return min(max(each, FEWEST_SAMPLES), MOST_SAMPLES)


def mean_reflection(lobes: LobeBatch, samples: int) -> Tensor:
    """The mean of rho_j over light and view, `[J]` in 1/sr: the integral of [WDR11 Eq. 9].

    Views and lights come from one Sobol sequence, lights are drawn by the lobe, and a direction
    under the texel's horizon counts as 0. Faster than `lobe_intensity`, as it stays in the frame
    of the lobe, where no pair is rotated; it also has more views about the normal.

    Args:
        lobes: J lobes.
        samples: directions of each lobe, a power of two.
    """
    mean = torch.zeros_like(lobes.angle)
    wo, importance, u = _points(samples, mean.dtype, mean.device)
    weight = importance * view_step(wo[..., 2], lobes.horizon)  # [1, S]
    up = frame_from_normal(lobes.normal, lobes.angle)[:, :, 2]  # [J, 3], the texel's normal
    for model, rows in _blocks(lobes, samples):
        kappa = lobes.kappa.index_select(0, rows)[:, None]  # [B, 1, P]
        wi = REGISTRY[model].sample(kappa, wo, u)  # [B, S, 3]
        normal = up.index_select(0, rows)[:, None]  # [B, 1, 3]
        of_texel = _cosine(normal, wi)
        cosine = lit_cosine(wi[..., 2].clamp(min=0.0), normal[..., 2], of_texel, lobes.lowest)
        value = REGISTRY[model].eval(kappa, wi, wo) * cosine  # Eq. (3)
        density = REGISTRY[model].pdf(kappa, wi, wo).clamp(min=torch.finfo(mean.dtype).tiny)
        seen = of_texel.clamp(0.0, 1.0) * _cosine(normal, wo).clamp(0.0, 1.0)
        mean[rows] = (value / density * weight * seen.ceil()).mean(dim=1)
    return mean / (2.0 * math.pi)


@lru_cache(maxsize=4)
def _points(
    samples: int, dtype: torch.dtype, device: torch.device
) -> tuple[Tensor, Tensor, Tensor]:
    """Views `[1, S, 3]`, their weights `[S]` of mean 1, and numbers `[1, S, 3]` for `sample`.

    Most views are even over the hemisphere; the part CROWDED lies about its pole on all scales
    down to POLE. Weighted by the balance heuristic [Veach & Guibas 1995].
    """
    # The points are the lower corners of their cells: half a cell further they are the middles.
    points = torch.quasirandom.SobolEngine(5).draw(samples, dtype=torch.float64) + 0.5 / samples
    span = math.log1p(1.0 / POLE)
    crowded = POLE * torch.expm1(span * points[:, 0])  # 1 - cos(theta_o)
    first = torch.arange(samples) < round(CROWDED * samples)
    below = torch.where(first, crowded, points[:, 0])
    weight = 1.0 / (1.0 - CROWDED + CROWDED / (span * (below + POLE)))
    wo = direction_from_angles(torch.arccos(1.0 - below), 2.0 * math.pi * points[:, 1])
    # Contiguous components are the fastest layout for `eval`.
    wo = wo.T.contiguous().T[None].to(device, dtype)
    return wo, weight.to(device, dtype), points[None, :, 2:].to(device, dtype)


def _blocks(lobes: LobeBatch, samples: int) -> Iterator[tuple[int, Tensor]]:
    """(model, indices of its lobes) of blocks of one model that fit the cache."""
    size = max(1, (CUDA_BLOCK if lobes.kappa.is_cuda else CPU_BLOCK) // samples)
    for model, rows in lobes.by_model():
        yield from ((model, block) for block in rows.split(size))


def _cosine(first: Tensor, second: Tensor) -> Tensor:
    """Dot products `[...]` of directions `[..., 3]`; written out, as CPUs sum short rows slowly."""
    products = (first[..., i] * second[..., i] for i in range(3))
    return sum(products, start=first.new_zeros(()))
