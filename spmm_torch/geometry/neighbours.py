"""The nearest of many directions, by a k-d tree [Ben75]: no table of all pairs is ever made.

References:
    [Ben75] Jon Louis Bentley, Multidimensional Binary Search Trees Used for Associative Searching,
        Communications of the ACM 18(9), 1975.
"""

from __future__ import annotations

from typing import Any

import torch
from scipy.spatial import KDTree
from torch import Tensor


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
    ranks: Any = list(range(1, count + 1))  # a list keeps the last axis for one neighbour, too
    distance, index = tree.query(_exact(points).numpy(), k=ranks)
    return torch.from_numpy(distance).to(points.device), torch.from_numpy(index).to(points.device)


def _exact(points: Tensor) -> Tensor:
    """Points `[N, P]` float64 on the CPU."""
    return points.detach().to(device="cpu", dtype=torch.float64)
