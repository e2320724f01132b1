"""Polar plots: a function over the hemisphere as a surface whose radius is its value."""

from __future__ import annotations

import math

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.spatial import Delaunay
from torch import Tensor

from ..geometry.directions import (
    direction_from_angles,
    disk_from_normal,
    frame_from_normal,
    hemisphere_spiral,
)

# Directions of a smooth surface, and of the rim that closes it.
EVEN, RIM = 2500, 180
# Rings about a narrow peak: their angles from it in radians, and directions on each.
RINGS, RING_DIRECTIONS = torch.logspace(math.log10(0.004), math.log10(0.5), 22), 48
# The rim lies just above the horizon, where lobes still have a value.
RIM_THETA = math.radians(89.9)


def polar_directions(peaks: Tensor, even: int = EVEN, rim: int = RIM) -> Tensor:
    """Upper unit directions `[N, 3]`: evenly spread, and dense about `peaks [P, 3]`."""
    azimuth = torch.arange(rim, dtype=torch.float64) * (2.0 * math.pi / rim)
    edge = direction_from_angles(torch.full_like(azimuth, RIM_THETA), azimuth)
    spread = hemisphere_spiral(even, math.radians(89.0)).double()
    return torch.cat((edge, spread, _rings(peaks.double())))


def _rings(peaks: Tensor) -> Tensor:
    """Directions on rings about upper `peaks [P, 3]`, those under the rim left out."""
    upper = peaks[peaks[:, 2] > 0.0]
    azimuth = torch.arange(RING_DIRECTIONS, dtype=torch.float64)
    azimuth = azimuth * (2.0 * math.pi / RING_DIRECTIONS)
    pairs = torch.cartesian_prod(RINGS.double(), azimuth)
    local = direction_from_angles(*pairs.unbind(-1))  # [R, 3]
    top = torch.tensor([[0.0, 0.0, 1.0]], dtype=torch.float64)
    frames = frame_from_normal(upper, torch.zeros(len(upper), dtype=torch.float64))
    around = (torch.cat((top, local)) @ frames).flatten(0, 1)  # [P * (R + 1), 3]
    return around[around[:, 2] > math.cos(RIM_THETA)]


def mirror_directions(wo: Tensor, normals: Tensor) -> Tensor:
    """wo `[3]` mirrored at unit normals `[P, 3]`: `[P, 3]`, where glossy lobes peak."""
    return 2.0 * (normals @ wo)[:, None] * normals - wo


def polar_triangles(directions: Tensor) -> NDArray[np.int64]:
    """Triangles `[F, 3]` between upper directions `[N, 3]`, Delaunay on the equal-area disk."""
    return Delaunay(disk_from_normal(directions).numpy()).simplices.astype(np.int64)


def polar_points(directions: Tensor, values: Tensor, scale: float = 1.0) -> NDArray[np.float64]:
    """Points `[N, 3]` at distance `scale * values [N]` from the origin along `directions`."""
    return (directions.double() * (scale * values.double())[:, None]).numpy()
