"""Stages cluster and sample: k-means over all texels, and stratified samples [WDR11 §4.1]."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import torch
from torch import Tensor

from ..config import ClusterConfig, SampleConfig
from ..data import BTF
from ..solvers.kmeans import kmeans

# Columns that the randomized sketch carries beyond the components asked for [HMT11, §4.2].
OVERSAMPLING = 8
# Values that are held as float32 at once while the data are passed over: 256 MB.
BLOCK_VALUES = 1 << 26

Advance = Callable[[int], None]


@dataclass(frozen=True)
class Clusters:
    """Texels by cluster.

    Attributes:
        points: principal coordinates of the texels, `[T, P]`.
        labels: cluster of each texel, `[T]`, 0 to K - 1; every cluster has a texel.
        members: texel indices of each cluster, ascending.
    """

    points: Tensor
    labels: Tensor
    members: list[Tensor]


def texel_blocks(btf: BTF) -> list[slice]:
    """Slices of consecutive texels that fit in BLOCK_VALUES."""
    size = max(1, BLOCK_VALUES // (btf.pair_count * btf.channels))
    return [slice(i, min(i + size, btf.texel_count)) for i in range(0, btf.texel_count, size)]


def principal_points(
    btf: BTF,
    components: int,
    generator: torch.Generator,
    device: torch.device,
    advance: Advance,
) -> Tensor:
    """Coordinates `[T, P]` of the texels on their leading right singular vectors.

    A randomized range finder with one power iteration [Halko, Martinsson, Tropp 2011, Alg. 4.4]:
    distances between texels are kept but for what the components leave out, and k-means never
    touches vectors of D * C values. Calls `advance(texels)` along the way, 2 T in all.
    """
    width = btf.pair_count * btf.channels
    rank = min(components + OVERSAMPLING, btf.texel_count, width)
    probe = torch.randn(width, rank, generator=generator).to(device)
    blocks = texel_blocks(btf)
    back = torch.zeros(width, rank, device=device)
    for block in blocks:  # Y^T (Y probe), without keeping Y
        values = btf.texels(block, device).flatten(1)
        back += values.T @ (values @ probe)
        advance(len(values))
    basis = torch.linalg.qr(back).Q  # [D C, rank], spans the leading right singular vectors
    parts = []
    for block in blocks:
        values = btf.texels(block, device).flatten(1)
        parts.append((values @ basis).cpu())
        advance(len(values))
    points = torch.cat(parts)
    rotation = torch.linalg.svd(points, full_matrices=False).Vh.T
    return (points @ rotation)[:, :components]


def cluster_texels(
    btf: BTF,
    config: ClusterConfig,
    generator: torch.Generator,
    device: torch.device,
    advance: Advance,
) -> Clusters:
    """k-means of all texels; fewer clusters where there are fewer distinct texels."""
    points = principal_points(btf, config.components, generator, device, advance)
    count = min(config.count, btf.texel_count)
    labels = kmeans(points, count, generator, iterations=config.iterations).labels
    members = [torch.nonzero(labels == k).squeeze(1) for k in range(int(labels.max()) + 1)]
    return Clusters(points, labels, members)


def sample_texels(
    clusters: Clusters, config: SampleConfig, generator: torch.Generator
) -> tuple[Tensor, Tensor]:
    """One random texel of each sub-cluster of each cluster.

    Returns:
        (texel index `[S]`, its cluster `[S]`).
    """
    texels, owners = [], []
    for cluster, members in enumerate(clusters.members):
        count = min(config.per_cluster, len(members))
        labels = kmeans(clusters.points[members], count, generator).labels
        for stratum in range(int(labels.max()) + 1):
            inside = members[labels == stratum]
            choice = int(torch.randint(len(inside), (1,), generator=generator))
            texels.append(inside[choice])
            owners.append(cluster)
    return torch.stack(texels), torch.tensor(owners)
