"""Stages cluster and sample: k-means over all texels, and stratified samples [WDR11 §4.1].

References:
    [HMT11] Nathan Halko, Per-Gunnar Martinsson, Joel A. Tropp, Finding Structure with Randomness:
        Probabilistic Algorithms for Constructing Approximate Matrix Decompositions, SIAM Review
        53(2), 2011.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import torch
from torch import Tensor

from ..config.fit import FitConfig
from ..data.blocks import block_texels
from ..data.error_weights import Weights
from ..runtime.memory import slices
from ..runtime.progress import Advance
from ..solvers.kmeans import kmeans
from ..solvers.status import Solver, StatusCounts
from .problem import Problem

# Columns of the random matrix beyond the components asked for [HMT11, §4.2].
OVERSAMPLING = 8
# Texels by which the space of the coordinates is found: every fourth, of large textures only. The
# space of so many is that of all, but for texels like no others.
SKETCH_STEP, SKETCH_LEAST = 4, 1 << 14
# Coordinates for each component of the residual, whose coefficients start from them.
SPAN = 2
# Bound of the relative rounding error of principal coordinates: texels closer than this are equal,
# so equal texels stay equal whatever their blocks.
COORDINATE_ROUNDING = 1e-5


@dataclass(frozen=True)
class Clusters:
    """The clusters of all texels.

    Attributes:
        points: principal coordinates of the texels, `[T, P]`.
        functions: the functions of which these are coordinates, weighted, `[D, P, C]`.
        labels: cluster of each texel, `[T]`, 0 to K - 1; no cluster is empty.
        members: ascending texel indices `[n]` of each cluster.
        solvers: how k-means ended.
    """

    points: Tensor
    functions: Tensor
    labels: Tensor
    members: list[Tensor]
    solvers: StatusCounts

    @classmethod
    def of_labels(
        cls,
        points: Tensor,
        functions: Tensor,
        labels: Tensor,
        solvers: StatusCounts | None = None,
    ) -> Clusters:
        """The clusters of labels from 0 to K - 1.

        Args:
            points: coordinates of the texels, `[T, P]`.
            functions: of these coordinates, `[D, P, C]`.
            labels: cluster of each texel, `[T]`.
            solvers: how k-means ended; None: it was not run.
        """
        count = int(labels.max()) + 1
        members = [torch.nonzero(labels == k).squeeze(1) for k in range(count)]
        return cls(points, functions, labels, members, solvers or StatusCounts.none())

    def to_tensors(self) -> dict[str, Tensor]:
        """Tensors for a checkpoint: `points [T, P]`, `labels [T]` and others by their names."""
        own = {name: getattr(self, name) for name in ("points", "functions", "labels")}
        return {**own, "solvers": self.solvers.table}

    @classmethod
    def from_tensors(cls, tensors: dict[str, Tensor]) -> Clusters:
        """The clusters of a checkpoint; see `Clusters.to_tensors`."""
        solvers = StatusCounts(tensors["solvers"])
        return cls.of_labels(tensors["points"], tensors["functions"], tensors["labels"], solvers)


@dataclass(frozen=True)
class Samples:
    """Texels on which lobes are searched.

    Attributes:
        texels: their indices, `[S]`.
        clusters: cluster of each, `[S]`.
        solvers: how k-means of the sub-clusters ended.
    """

    texels: Tensor
    clusters: Tensor
    solvers: StatusCounts = field(default_factory=StatusCounts.none)

    def __len__(self) -> int:
        return len(self.texels)


def cluster_texels(problem: Problem) -> Clusters:
    """k-means of all texels [WDR11 §4.1]; fewer clusters where fewer texels are distinct."""
    context, asked = problem.context, problem.config.cluster.count
    count = problem.btf.texel_count
    clusters = context.stage(
        "cluster",
        Clusters,
        lambda advance: _clusters(problem, advance),
        count + len(range(count)[_sketched(count)]),
        "texels",
    )
    if warning := warning_of_fewer_clusters(len(clusters.members), asked, count):
        context.progress.say(warning)
    return clusters


def _clusters(problem: Problem, advance: Advance) -> Clusters:
    """k-means of the principal coordinates, by the first rank for all."""
    btf, config, context = problem.btf, problem.config.cluster, problem.context
    generator = context.generator("cluster")
    points, functions = principal_points(problem, generator, advance)
    near = points[:, : config.components]
    found = context.ranks.first(
        lambda: kmeans(
            near,
            min(config.count, btf.texel_count),
            generator,
            iterations=config.iterations,
            resolution=COORDINATE_ROUNDING * near.norm(dim=1),
            weights=problem.weights.of_texels(slice(None)),
        )
    )
    ended = StatusCounts.of(Solver.KMEANS, found.status)
    return Clusters.of_labels(points, functions, found.labels, ended)


def warning_of_fewer_clusters(count: int, asked: int, texels: int) -> str | None:
    """A warning if the texels allow fewer clusters than were asked for."""
    if count == asked:
        return None
    cause = f"only {texels} texels" if texels < asked else "too few distinct texels"
    return f"warning: cluster.count lowered from {asked} to {count}, there are {cause}"


def principal_points(
    problem: Problem, generator: torch.Generator, advance: Advance
) -> tuple[Tensor, Tensor]:
    """(coordinates of the texels `[T, P]`, their leading right singular vectors `[D, P, C]`).

    They are found by a randomized range finder with one power iteration [HMT11, Alg. 4.4]. k-means
    then works on P coordinates instead of D * C values. `advance` receives the number of texels
    that were read, those of the sketch twice.
    """
    btf, ranks, device = problem.btf, problem.context.ranks, problem.device
    components = coordinate_count(problem.config)
    width = btf.pair_count * btf.channels
    rank = min(components + OVERSAMPLING, btf.texel_count, width)
    probe = torch.randn(btf.pair_count, btf.channels, rank, generator=generator)
    probe = probe.flatten(0, 1).to(device)
    size = block_texels(btf, device)
    # float64, so that the order of the blocks does not matter.
    back = torch.zeros(width, rank, dtype=torch.float64, device=device)
    for block in _sketch_blocks(btf.texel_count, size)[ranks.rank :: ranks.size]:
        values = _weighted(problem.weights, problem.values(block).flatten(1), block)
        back += values.T @ (values @ probe)  # Y^T (Y probe), without keeping Y
        advance(ranks.size * len(values))
    basis = torch.linalg.qr(ranks.sum(back).float()).Q  # [D C, rank], the right singular space
    points = torch.zeros(btf.texel_count, rank)
    for block in list(slices(btf.texel_count, size))[ranks.rank :: ranks.size]:
        values = problem.values(block).flatten(1)
        points[block] = (values @ basis).cpu()
        advance(ranks.size * len(values))
    points = ranks.sum(points)  # each row is zero on all ranks but one
    spread = _weighted(problem.weights, points, slice(None))
    rotation = torch.linalg.svd(spread, full_matrices=False).Vh.T
    turned = (basis.cpu() @ rotation)[:, :components]  # [D C, P]
    functions = turned.unflatten(0, (btf.pair_count, btf.channels)).transpose(1, 2)
    return (points @ rotation)[:, :components], functions.contiguous()


def _sketched(texels: int) -> slice:
    """The texels by which the space of the coordinates is found."""
    return slice(0, texels, min(SKETCH_STEP, max(texels // SKETCH_LEAST, 1)))


def _sketch_blocks(texels: int, size: int) -> list[slice]:
    """The same in blocks of at most `size` texels."""
    rows = range(texels)[_sketched(texels)]
    parts = (rows[block] for block in slices(len(rows), size))
    return [slice(part.start, part.stop, part.step) for part in parts]


def coordinate_count(config: FitConfig) -> int:
    """The number of principal coordinates that some settings ask for, P."""
    return max(config.cluster.components, SPAN * config.residual.rank)


def _weighted(weights: Weights, rows: Tensor, texels: slice) -> Tensor:
    """Rows `[n, P]` of `texels` times the square roots of their weights."""
    of_texels = weights.of_texels(texels, rows.device)
    return rows if of_texels is None else rows * of_texels.sqrt()[:, None]


def sample_texels(problem: Problem, clusters: Clusters) -> Samples:
    """One texel of each sub-cluster of each cluster, drawn by weight [WDR11 §4.1]."""
    weights, generator = problem.weights, problem.context.generator("sample")
    texels, owners, counts = [], [], []
    for cluster, members in enumerate(clusters.members):
        count = min(problem.config.sample.per_cluster, len(members))
        points = clusters.points[members, : problem.config.cluster.components]
        own = weights.of_texels(members)
        resolution = COORDINATE_ROUNDING * points.norm(dim=1)
        strata = kmeans(points, count, generator, resolution=resolution, weights=own)
        counts.append(StatusCounts.of(Solver.KMEANS, strata.status))
        for stratum in range(int(strata.labels.max()) + 1):
            inside = members[strata.labels == stratum]
            texels.append(inside[_drawn(inside, weights, generator)])
            owners.append(cluster)
    return Samples(torch.stack(texels), torch.tensor(owners), StatusCounts.sum(counts))


def _drawn(texels: Tensor, weights: Weights, generator: torch.Generator) -> int:
    """Position of one of `texels [n]`, drawn by weight."""
    probability = weights.of_texels(texels)
    if probability is None or not bool(probability.any()):
        return int(torch.randint(len(texels), (1,), generator=generator))
    return int(torch.multinomial(probability.double(), 1, generator=generator))
