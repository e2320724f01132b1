"""Vector quantization: every texel is the mean of its cluster, at the bytes of our own model."""

from __future__ import annotations

import torch

from ...config.fit import FitConfig
from ...data import BTF
from ...data.error_weights import UNIFORM
from ...fit.cluster import principal_points
from ...fit.problem import Problem as FitProblem
from ...runtime.context import Context
from ...solvers.kmeans import kmeans
from ..protocol import measure
from .problem import HALF, HALF_BYTES, WHOLE, Peer, Problem, Row, row, snr_of


def codebook_size(problem: Problem) -> int:
    """The number of means in float16 that the bytes of our own model allow."""
    width = problem.btf.pair_count * problem.btf.channels
    return max(1, min(problem.byte_budget // (HALF_BYTES * width), problem.btf.texel_count))


def label_bytes(clusters: int) -> int:
    """Bytes of the label of a texel."""
    return 1 if clusters <= 256 else 2


def clustered(btf: BTF, count: int, device: torch.device) -> torch.Tensor:
    """Labels `[T]` on the CPU, by the k-means of our own fit."""
    generator = torch.Generator().manual_seed(0)
    config = FitConfig()
    fit = FitProblem.build(btf, UNIFORM, config, Context.build(str(device)))
    points, _ = principal_points(fit, generator, lambda _: None)
    near = points[:, : config.cluster.components]
    return kmeans(near, count, generator, iterations=config.cluster.iterations).labels


def run(problem: Problem) -> list[Row]:
    """Quantizes to as many means as the bytes of our own model allow."""
    count, values = codebook_size(problem), problem.values

    @torch.no_grad()
    def work() -> tuple[torch.Tensor, torch.Tensor]:
        labels = clustered(problem.btf, count, problem.device).to(values.device)
        present = torch.unique(labels).tolist()
        means = torch.stack([values[labels == cluster].mean(0) for cluster in present])
        return labels, means.to(HALF)

    (labels, means), timing = measure(work, problem.protocol, problem.device)
    texels = problem.btf.texel_count
    size = means.numel() * HALF_BYTES + texels * label_bytes(len(means))
    snr = snr_of(values, means.float()[labels])
    return [row(f"vector quantization, {len(means)} means", WHOLE, texels, timing, snr, size=size)]


PEER = Peer("vector quantization", "every texel is one of as many means as our bytes allow", run)
