"""Local PCA: a mean and a few principal components for each cluster, at the bytes of our model.

The strongest linear method at equal bytes [Mueller, Meseth, Klein 2003]. The bytes allow few
clusters with many components, or many clusters with few; the best split is published.
"""

from __future__ import annotations

import torch
from torch import Tensor

from ..protocol import measure
from .problem import HALF, HALF_BYTES, WHOLE, Peer, Problem, Row, row, snr_of
from .vector_quantization import clustered, label_bytes

CLUSTERS = (1, 2, 4, 8, 16)


def component_count(problem: Problem, clusters: int) -> int:
    """Components of each cluster that the bytes of our own model allow."""
    texels, width = problem.btf.texel_count, problem.btf.pair_count * problem.btf.channels
    left = problem.byte_budget - texels * label_bytes(clusters)
    left -= HALF_BYTES * clusters * width
    return max(0, left // (HALF_BYTES * (clusters * width + texels)))


def local_pca(values: Tensor, labels: Tensor, components: int) -> tuple[Tensor, int]:
    """Approximated values `[T, D, C]` by components in float16, and their bytes.

    Args:
        values: of the BTF, `[T, D, C]`.
        labels: cluster of each texel, `[T]`.
        components: of each cluster.
    """
    fitted = torch.empty_like(values)
    size = len(labels) * label_bytes(int(labels.max()) + 1)
    for cluster in torch.unique(labels).tolist():
        members = torch.nonzero(labels == cluster).squeeze(1)
        own = values[members].flatten(1)  # [n, D C]
        mean = own.mean(0, keepdim=True)
        centred = own - mean
        rank = min(components, len(members) - 1)
        vectors = torch.linalg.eigh((centred @ centred.T).double()).eigenvectors
        basis = torch.linalg.qr(centred.T @ vectors[:, len(members) - rank :].float()).Q
        weights, basis = (centred @ basis).to(HALF), basis.to(HALF)  # [n, r], [D C, r]
        near = weights.float() @ basis.float().T + mean.to(HALF).float()
        fitted[members] = near.view_as(values[members])
        size += HALF_BYTES * (weights.numel() + basis.numel() + mean.numel())
    return fitted, size


def run(problem: Problem) -> list[Row]:
    """Measures all splits of the bytes, and keeps the best one."""
    rows = []
    for clusters in CLUSTERS:
        components = component_count(problem, clusters)
        if components == 0 and rows:
            break

        @torch.no_grad()
        def work(clusters: int = clusters, components: int = components) -> tuple[Tensor, int]:
            labels = clustered(problem, clusters).to(problem.device)
            return local_pca(problem.values, labels, components)

        (fitted, size), timing = measure(work, problem.protocol, problem.device, warm_up=not rows)
        name = f"local PCA, {clusters} x {components}"
        snr = snr_of(problem.values, fitted)
        note = f"best split of the bytes among {', '.join(map(str, CLUSTERS))} clusters"
        rows.append(row(name, WHOLE, problem.btf.texel_count, timing, snr, size=size, note=note))
    return [max(rows, key=lambda each: each["snr_db"])]


PEER = Peer("local PCA", "clusters with principal components, at the bytes of our model", run)
