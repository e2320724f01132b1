"""The nearest of many directions, by a k-d tree [Ben75]: no table of all pairs is ever made.

References:
    [Ben75] Jon Louis Bentley, Multidimensional Binary Search Trees Used for Associative Searching,
        Communications of the ACM 18(9), 1975.
"""

from __future__ import annotations

import torch
from scipy.spatial import KDTree
from torch import Tensor

# Unit vectors closer than this are one measured direction, in radians: a hundredth of the
# resolution of the formats.
MEASURED_ALIKE = 2e-5


def nearest(points: Tensor, among: Tensor, count: int = 1) -> tuple[Tensor, Tensor]:
    """The `count` points of `among` that are nearest to each point, the nearest first.

    Args:
        points: `[N, P]`.
        among: `[M, P]`, at least `count` of them.
        count: neighbours of each point.

    Returns:
        (distance `[N, count]` float64, index into `among` `[N, count]`), on the device of `points`.
    """
    tree = KDTree(_exact(among).numpy())
    found = tree.query(_exact(points).numpy(), k=count)
    distance, index = (torch.as_tensor(part).view(-1, count) for part in found)
    return distance.to(points.device), index.to(points.device)


def measured_alike(points: Tensor, among: Tensor) -> tuple[Tensor, Tensor]:
    """Which of the unit vectors `points [N, 3]` are among the measured ones `among [M, 3]`.

    Returns:
        (whether it is `[N]` bool, index of the nearest of `among` `[N]`).
    """
    distance, index = nearest(points, among)
    return distance[:, 0] < MEASURED_ALIKE, index[:, 0]


def _exact(points: Tensor) -> Tensor:
    """Points `[N, P]` float64 on the CPU."""
    return points.detach().to(device="cpu", dtype=torch.float64)
