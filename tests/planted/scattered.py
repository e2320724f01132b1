"""Scattered samples of lobes that are known, as NPZ."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from tests.planted.directions import random_directions
from tests.planted.lobes import Lobe, lobe_batch

LOBES = lobe_batch(
    Lobe("lambertian"),
    Lobe("ward", (0.25, 0.25), 10.0, 30.0),
    Lobe("ward", (0.4, 0.3), 15.0, 200.0),
)
WEIGHTS = torch.tensor([[0.3, 0.2, 0.1], [0.2, 0.2, 0.2], [0.0, 0.1, 0.2]])  # [J, C]
STEEPEST = 1.4  # polar angle of the most grazing direction, in radians


def random_pairs(count: int, seed: int) -> tuple[Tensor, Tensor]:
    """Lights and views `[count, 3]` float32, of which no two are the same."""
    wi, wo = (random_directions(count, 2 * seed + side, STEEPEST) for side in (0, 1))
    return wi.float(), wo.float()


def planted_values(wi: Tensor, wo: Tensor, texel: int = 0) -> Tensor:
    """Values `[N, 3]` at directions `[N, 3]`; texels have the lobes in other shares."""
    share = 1.0 + torch.arange(3) * (texel % 4)
    return torch.einsum("jn,jc->nc", LOBES.eval(wi[None], wo[None]), WEIGHTS * share[:, None])


def save_samples(
    path: Path, texels: int, pairs: int, *, shared: bool = False, **more: np.ndarray
) -> Path:
    """A list of `pairs` samples of each texel, at its own pairs or at those of the first."""
    rows = []
    for texel in range(texels):
        wi, wo = random_pairs(pairs, 1 if shared else 1 + texel)
        rows.append((wi, wo, planted_values(wi, wo, texel), torch.full((pairs,), texel)))
    arrays = (torch.cat(column).numpy() for column in zip(*rows, strict=True))
    named = dict(zip(("wi", "wo", "rgb", "texel"), arrays, strict=True))
    np.savez(path, allow_pickle=False, **named, **more)
    return path
