"""Random directions of the upper hemisphere."""

from __future__ import annotations

import math

import torch
from torch import Tensor

from spmm_torch.geometry.directions import direction_from_angles


def random_directions(
    count: int,
    seed: int,
    max_theta: float = math.pi / 2.0,
    dtype: torch.dtype = torch.float64,
) -> Tensor:
    """Unit directions `[count, 3]` within `max_theta` of z, even by area."""
    u = torch.rand(count, 2, generator=torch.Generator().manual_seed(seed), dtype=dtype)
    theta = torch.arccos(1.0 - u[:, 0] * (1.0 - math.cos(max_theta)))
    return direction_from_angles(theta, 2.0 * math.pi * u[:, 1])
