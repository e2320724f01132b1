"""k-means with greedy k-means++ seeding, exact on degenerate data.

References:
    [AV07] David Arthur, Sergei Vassilvitskii, k-means++: The Advantages of Careful Seeding,
        ACM-SIAM Symposium on Discrete Algorithms (SODA), 2007; the greedy variant with several
        candidates a centre is their §4 remark, as in scikit-learn.
    [Llo82] Stuart P. Lloyd, Least Squares Quantization in PCM, IEEE Transactions on Information
        Theory 28(2), 1982.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor

from ..errors import ConfigError, DataError
from .status import Status

# float64 distances in one block (32 MiB): bounds the memory for any N.
BLOCK_ELEMENTS = 2**22


@dataclass(frozen=True)
class KMeansResult:
    """Clusters, none of them empty.

    Attributes:
        labels: `[N]` long, 0 to K - 1.
        centers: means of their points, `[K, P]`.
        objective: sum of squared distances.
        status: CONVERGED: the labels stopped changing, or every distinct point is a centre.
            LIMIT: of iterations.
    """

    labels: Tensor
    centers: Tensor
    objective: float
    status: Status


def kmeans(
    points: Tensor,
    k: int,
    generator: torch.Generator,
    *,
    iterations: int = 100,
    candidates: int | None = None,
    resolution: Tensor | None = None,
    weights: Tensor | None = None,
    block: int = BLOCK_ELEMENTS,
) -> KMeansResult:
    """Clusters points by k-means [AV07] [Llo82].

    Args:
        points: `[N, P]`, finite, N >= 1.
        k: number of clusters; fewer distinct points give one cluster each.
        generator: CPU generator, the only source of randomness.
        iterations: most iterations of Lloyd; they end when the labels stop changing.
        candidates: candidates for each centre; default 2 + log k as in scikit-learn.
        resolution: uncertainty of each point, `[N]`: a point closer to a centre than this counts
            as a copy of it. Default: 0.
        weights: of the points in the objective and in the means, `[N]`, positive. Default: 1.
        block: distances of one block.

    Returns:
        Labels, centres in the dtype of `points`, the objective and the status.

    Raises:
        ConfigError: k is not positive.
        DataError: there are no points, or some are not finite.
    """
    if k < 1:
        raise ConfigError(f"k-means was asked for {k} clusters; ask for at least 1.")
    if points.dim() != 2 or points.shape[0] == 0:
        shape = list(points.shape)
        raise DataError(f"k-means got points of shape {shape}; it needs [N, P] with N at least 1.")
    if not bool(points.isfinite().all()):
        raise DataError("k-means got points that are NaN or infinite; give finite values.")
    tries = 2 + int(math.log(k)) if candidates is None else candidates
    # float64, because the expansion of |x - c|^2 below cancels for close centres.
    shifted = points.double() - points.double().mean(0)  # [N, P]
    weight = None if weights is None else weights.to(shifted)
    blur = points.new_zeros(len(points)) if resolution is None else resolution
    centers, remaining = _seed(shifted, k, tries, generator, blur.double().square(), weight)
    if remaining > 0:
        labels, status = _lloyd(shifted, centers, iterations, weight, block)
    else:  # every distinct point is a centre
        labels, status = _assign_exactly(shifted, centers, block), Status.CONVERGED
    centers = _means(shifted, labels, centers.shape[0], weight, block)
    errors = (shifted - centers[labels]).square().sum(1)
    objective = _weighted(errors, weight).sum().item()
    centers = centers + points.double().mean(0)
    objective = objective if remaining > 0 else 0.0
    return KMeansResult(labels, centers.to(points.dtype), objective, status)


def _weighted(errors: Tensor, weight: Tensor | None) -> Tensor:
    """Errors `[N, ...]` times the weights `[N]` of their points."""
    return errors if weight is None else errors * weight.view(-1, *[1] * (errors.dim() - 1))


def _seed(
    points: Tensor,
    k: int,
    tries: int,
    generator: torch.Generator,
    blur: Tensor,
    weight: Tensor | None,
) -> tuple[Tensor, float]:
    """Greedy k-means++ [AV07]: centres `[K, P]` and the sum of squared distances to them.

    Squared distances come from differences, and those within `blur [N]` count as zero, so that a
    copy of a centre is never drawn: the sum is zero once every distinct point is a centre.
    """
    first = int(torch.randint(points.shape[0], (1,), generator=generator))
    chosen = [points[first]]
    blur = _weighted(blur, weight)
    nearest = _weighted(_squared_distance(points, points[first][None]), weight)[:, 0]  # [N]
    nearest = torch.where(nearest <= blur, 0.0, nearest)
    total = nearest.sum().item()
    while len(chosen) < k and total > 0:
        draw = torch.rand(tries, generator=generator, dtype=torch.float64).to(points.device)
        cumulative = nearest.cumsum(0)  # [N]
        drawn = torch.searchsorted(cumulative, draw * cumulative[-1], right=True)  # [candidates]
        drawn = drawn.clamp_max(points.shape[0] - 1)
        distance = _weighted(_squared_distance(points, points[drawn]), weight)
        trial = torch.minimum(distance, nearest[:, None])
        best = trial.sum(0).argmin()
        chosen.append(points[drawn[best]])
        nearest = torch.where(trial[:, best] <= blur, 0.0, trial[:, best])
        total = nearest.sum().item()
    return torch.stack(chosen), total


def _squared_distance(points: Tensor, centers: Tensor) -> Tensor:
    """Squared distances `[N, K]` by differences: slow, but exactly zero between equal points."""
    mode = "donot_use_mm_for_euclid_dist"
    return torch.cdist(points, centers, compute_mode=mode).square()


def _assign_exactly(points: Tensor, centers: Tensor, block: int) -> Tensor:
    """Nearest centre `[N]` by differences, for centres that may be arbitrarily close."""
    size = max(1, block // centers.shape[0])
    parts = [_squared_distance(part, centers).argmin(1) for part in points.split(size)]
    return torch.cat(parts)


def _assign(points: Tensor, centers: Tensor, block: int = BLOCK_ELEMENTS) -> tuple[Tensor, Tensor]:
    """Nearest centre `[N]` and squared distance to it `[N]`, by a matrix product in blocks."""
    offset = centers.square().sum(1)  # [K]
    size = max(1, block // centers.shape[0])
    least, labels = [], []
    for part in points.split(size):
        value, label = torch.addmm(offset, part, centers.T, alpha=-2).min(1)  # [n]
        least.append(value + part.square().sum(1))
        labels.append(label)
    return torch.cat(labels), torch.cat(least).clamp_min(0)


def _lloyd(
    points: Tensor, centers: Tensor, iterations: int, weight: Tensor | None, block: int
) -> tuple[Tensor, Status]:
    """Lloyd iterations until the labels stay; labels `[N]`, every cluster with a point [Llo82]."""
    labels, distance = _assign(points, centers, block)
    labels = _fill_empty(points, labels, distance, centers.shape[0])
    for _ in range(iterations):
        centers = _means(points, labels, centers.shape[0], weight, block)
        moved, distance = _assign(points, centers, block)
        moved = _fill_empty(points, moved, distance, centers.shape[0])
        if torch.equal(moved, labels):
            return labels, Status.CONVERGED
        labels = moved
    return labels, Status.LIMIT


def _fill_empty(points: Tensor, labels: Tensor, distance: Tensor, k: int) -> Tensor:
    """Gives each empty cluster the point farthest from its centre, one at a time."""
    size = torch.bincount(labels, minlength=k)  # [K]
    labels, distance = labels.clone(), distance.clone()
    for empty in (size == 0).nonzero()[:, 0].tolist():
        # A point alone in its cluster stays, or its cluster would be empty.
        movable = torch.where(size[labels] > 1, distance, -1.0)
        farthest = movable.argmax()
        size[labels[farthest]] -= 1
        size[empty] += 1
        labels[farthest] = empty
        to_new = _squared_distance(points, points[farthest][None])[:, 0]
        distance = torch.minimum(distance, to_new)
    return labels


def _means(points: Tensor, labels: Tensor, k: int, weight: Tensor | None, block: int) -> Tensor:
    """Mean of each cluster `[K, P]`, by matrix products: deterministic on a GPU, unlike scatter."""
    total = points.new_zeros(k, points.shape[1])
    size = torch.bincount(labels, weight, minlength=k)  # [K]
    cluster = torch.arange(k, device=points.device)[:, None]  # [K, 1]
    size_of_block = max(1, block // k)
    heavy = _weighted(points, weight).split(size_of_block)
    for part, label in zip(heavy, labels.split(size_of_block), strict=True):
        total += (cluster == label).to(points.dtype) @ part
    return total / size[:, None]
