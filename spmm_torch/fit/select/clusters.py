"""Stages select, refit and residual over all texels, cluster by cluster [WDR11 §4.1].

In a large cluster some texels, the pilot, are fit first with the lobes alone. All texels then
choose from the lobes of the pilot, beside the residual that the pilot leaves.
"""

from __future__ import annotations

from concurrent.futures import CancelledError
from dataclasses import dataclass, field, replace
from threading import Event

import torch
from torch import Tensor

from ...data.blocks import block_texels, cpu_block_bytes
from ...data.error_weights import UNIFORM, Weights
from ...metrics import Totals
from ...runtime.context import Context
from ...runtime.memory import slices
from ...runtime.threads import side_by_side
from ...solvers.status import StatusCounts
from ..cluster import Clusters
from ..dictionary import Dictionary
from ..problem import Problem
from ..residual.errors import ClusterErrors, WeightedErrors, uniform_errors
from ..residual.exact import exact_where_doubtful
from ..residual.missing import MissingPairs
from .alternate import CPU_TEXELS, SELECT_BYTES, ClusterProblem, Solution, selection_blocks
from .products import Load, Products, cluster_products

# A cluster has a pilot if it has more texels than this many pilots; it saves little in others.
PILOTS = 4

PRECISIONS = {"float16": torch.float16, "float32": torch.float32}


@dataclass(frozen=True)
class ClusterFit:
    """The fit of one cluster of n texels.

    Attributes:
        index: lobes of the dictionary `[n, M]`, -1 for padding.
        weights: alpha `[n, M, C]`, of lobes that are not scaled to unit norm.
        code: the stored residual `[D, C]`.
        scale: its scale `[]`.
        totals: squared errors of the cluster over all measured values.
        weighted: the same with the weights of the values; None where these are all 1.
        solvers: problems solved, by solver and status.
    """

    index: Tensor
    weights: Tensor
    code: Tensor
    scale: Tensor
    totals: Totals
    weighted: Totals | None = None
    solvers: StatusCounts = field(default_factory=StatusCounts.none)

    def to_tensors(self) -> dict[str, Tensor]:
        """Tensors for a checkpoint: the attributes by name, sums of squares as rows `[N]`."""
        sums = {"totals": self.totals, "weighted": self.weighted}
        rows = {
            name: torch.tensor(part.row(), dtype=torch.float64)
            for name, part in sums.items()
            if part is not None
        }
        tensors = {name: getattr(self, name) for name in ("index", "weights", "code", "scale")}
        return tensors | rows | {"solvers": self.solvers.table}

    @classmethod
    def from_tensors(cls, tensors: dict[str, Tensor]) -> ClusterFit:
        """The fit of a checkpoint; see `ClusterFit.to_tensors`."""
        sums = {
            name: Totals(*tensors[name].tolist())
            for name in ("totals", "weighted")
            if name in tensors
        }
        return cls(**{**tensors, **sums, "solvers": StatusCounts(tensors["solvers"])})


@dataclass(frozen=True)
class SelectStage:
    """What the fits of all clusters have in common.

    Attributes:
        problem: the fit.
        points: principal coordinates of the texels, `[T, P]`.
        dictionary: all lobes.
        spare: bytes that the products of a cluster may take in memory.
        gram: D^T D of the whole dictionary, `[J, J]`; None where clusters choose from parts of it.
        gaps: direction pairs that were not measured; None: all were.
        stopped: set when the fit of a cluster is not needed any more.
    """

    problem: Problem
    points: Tensor
    dictionary: Dictionary
    spare: int
    gram: Tensor | None = None
    gaps: MissingPairs | None = None
    stopped: Event = field(default_factory=Event)


def fit_texels(problem: Problem, clusters: Clusters, dictionary: Dictionary) -> list[ClusterFit]:
    """Fits the texels and the residual of every cluster with the lobes that it may choose.

    A CPU works on several clusters at once, since most steps are too small for several threads.
    """
    btf, context = problem.btf, problem.context
    gaps = MissingPairs.of(btf.measured, btf.light, btf.view)
    with context.watch("select"):
        gram = dictionary.atoms @ dictionary.atoms.T if dictionary.is_shared else None
    shared = SelectStage(problem, clusters.points, dictionary, context.budget.spare, gram, gaps)
    at_once, threads = _clusters_at_once(shared, len(clusters.members))
    taken = (at_once - 1) * cluster_bytes(len(dictionary.atoms))
    spare = (shared.spare - taken) // at_once

    def work(cluster: int, stopped: Event) -> ClusterFit:
        contexts[cluster] = own = context.one_of(at_once)
        stage = replace(shared, problem=replace(problem, context=own), spare=spare, stopped=stopped)
        members = clusters.members[cluster]
        return own.once(
            f"texels-{cluster:04d}", ClusterFit, lambda: _fit_cluster(stage, cluster, members)
        )

    def done(cluster: int) -> None:
        context.watch.take(contexts.pop(cluster).watch)
        advance(len(clusters.members[cluster]))

    contexts: dict[int, Context] = {}
    with context.progress.stage("select", btf.texel_count, "texels") as advance:
        return side_by_side(work, range(len(clusters.members)), at_once, threads, done)


def cluster_bytes(atom_count: int) -> int:
    """Bytes that the fit of one cluster takes on a CPU, products apart."""
    return cpu_block_bytes() + SELECT_BYTES * CPU_TEXELS * atom_count


def _clusters_at_once(stage: SelectStage, clusters: int) -> tuple[int, int]:
    """(clusters that are fit at once, threads of each).

    There are as many as threads, or as memory allows. The threads of a cluster do not depend on the
    memory, so that sums round the same. Several ranks work on the same cluster at a time.
    """
    threads, atoms = torch.get_num_threads(), stage.dictionary.atoms
    if atoms.is_cuda or stage.problem.context.ranks.size > 1:
        return 1, threads
    wanted = min(threads, clusters)
    room = 1 + max(0, stage.spare) // cluster_bytes(len(atoms))
    return min(wanted, room), threads // wanted


def _fit_cluster(stage: SelectStage, cluster: int, texels: Tensor) -> ClusterFit:
    """Fits the `texels [n]` of one cluster, of which every rank has a part."""
    dictionary, config = stage.dictionary, stage.problem.config
    context = stage.problem.context
    where, gram = dictionary.choices[cluster], stage.gram
    start, size, solvers = None, config.select.pilot, StatusCounts.none()
    if size is not None and len(texels) > PILOTS * size:
        some = pilot_of(context.generator(f"pilot-{cluster}"), texels, size)
        pilot = _cluster_problem(stage, some, where, gram)
        start, needed, solvers = pilot.pilot()
        used = torch.nonzero(needed).squeeze(1)
        where, start = where[used], start.of(used)
        gram = pilot.products.gram[used[:, None], used]
    own = context.ranks.share(texels)
    problem = _cluster_problem(stage, texels, where, gram)
    fit = problem.solve(start).after(solvers)
    with context.watch("residual"):
        errors = _errors(stage, own, where, problem.products, fit)
    index, weights = joined([pair for part in context.ranks.gather(fit.on_cpu()) for pair in part])
    lobe = torch.where(index >= 0, where.cpu()[index.clamp(min=0)], -1)  # [n, M]
    weights = weights / dictionary.norm.cpu()[lobe.clamp(min=0)][..., None]
    counts = StatusCounts(context.ranks.sum(fit.solvers.table.cpu()))
    return ClusterFit(
        lobe, weights, errors.code, errors.scale, errors.totals, errors.weighted, counts
    )


def pilot_of(generator: torch.Generator, texels: Tensor, size: int) -> Tensor:
    """`size` of the `texels [n]` of a cluster, drawn at random."""
    order = torch.randperm(len(texels), generator=generator)
    return texels[order[:size].sort().values]


def _cluster_problem(
    stage: SelectStage, texels: Tensor, where: Tensor, gram: Tensor | None
) -> ClusterProblem:
    """The fit of the `texels [n]` that this rank has, with the lobes `where [J]`.

    Args:
        stage: of all clusters.
        texels: of one cluster.
        where: lobes of the dictionary.
        gram: their products with each other, `[J, J]`; None: computed.
    """
    problem, context = stage.problem, stage.problem.context
    with context.watch("select"):
        atoms = stage.dictionary.atoms[where]
        own = context.ranks.share(texels)
        products = _products(stage, own, atoms, problem.weights, gram)
    return ClusterProblem(products, problem.config, context)


def _passes(stage: SelectStage, texels: Tensor, weights: Weights) -> tuple[Load, list[slice]]:
    """The loader of weighted values of `texels [n]`, and the blocks to load."""
    btf, device = stage.problem.btf, stage.problem.device

    def load(part: slice) -> Tensor:
        if stage.stopped.is_set():
            raise CancelledError
        return weights.signals(btf, texels[part], device)

    return load, list(slices(len(texels), block_texels(btf, device)))


def _errors(
    stage: SelectStage, texels: Tensor, where: Tensor, products: Products, fit: Solution
) -> ClusterErrors:
    """The stored residual and the errors of a fit of `texels [n]` with the atoms `where [J]`."""
    problem, ranks = stage.problem, stage.problem.context.ranks
    atoms = stage.dictionary.atoms[where]
    precision = PRECISIONS[problem.config.residual.precision]
    if problem.weights.uniform:
        of_fit = (fit.error, fit.taken)
        errors = uniform_errors(products, atoms, fit.mean, of_fit, precision, ranks)
        passes, stored = _passes(stage, texels, UNIFORM), errors.stored().to(atoms.device)
        totals = exact_where_doubtful(errors.totals, passes, fit.fits, atoms, stored, ranks)
        return replace(errors, totals=totals)
    raw, measured = stage.dictionary.raw[where], problem.weights.measured
    measured = None if measured is None else measured.to(raw.device)
    seen = raw if measured is None else raw * measured
    plain = _products(stage, texels, seen, UNIFORM)
    scale = problem.weights.scale(atoms.device)
    weighted = WeightedErrors(products, atoms, plain, raw, scale, measured, stage.gaps)
    blocks = list(zip(selection_blocks(products), fit.fits, strict=True))
    errors = weighted.of_fit(fit.mean, blocks, precision, ranks)
    return _exact_weighted(stage, texels, weighted, fit, errors)


def _exact_weighted(
    stage: SelectStage, texels: Tensor, sums: WeightedErrors, fit: Solution, errors: ClusterErrors
) -> ClusterErrors:
    """`errors` without and with the weights, by another pass each where they may be rounding."""
    problem, ranks = stage.problem, stage.problem.context.ranks
    stored = errors.stored().to(sums.atoms.device)
    totals = exact_where_doubtful(
        errors.totals,
        _passes(stage, texels, UNIFORM),
        fit.fits,
        sums.seen(sums.raw),
        sums.seen(stored.T).T,
        ranks,
        sums.plain.importance,
    )
    assert errors.weighted is not None
    weighted = exact_where_doubtful(
        errors.weighted,
        _passes(stage, texels, problem.weights),
        fit.fits,
        sums.atoms,
        sums.scaled(stored.T).T,
        ranks,
        sums.products.importance,
    )
    return replace(errors, totals=totals, weighted=weighted)


def _products(
    stage: SelectStage,
    texels: Tensor,
    atoms: Tensor,
    weights: Weights,
    gram: Tensor | None = None,
) -> Products:
    """The products of `texels [n]` with `atoms [J, D]`, on disk where memory is short."""
    problem = stage.problem
    channels = problem.btf.channels
    size = 4 * len(texels) * len(atoms) * channels
    if not problem.weights.uniform:
        size *= 2  # one with and one without weights
    load, blocks = _passes(stage, texels, weights)
    return cluster_products(
        load,
        blocks,
        (len(texels), channels),
        atoms,
        points=stage.points[texels] if problem.config.residual.beside_lobes else None,
        gram=gram,
        in_memory=size <= stage.spare,
        ranks=problem.context.ranks,
        importance=weights.of_texels(texels, atoms.device),
    )


def joined(parts: list[tuple[Tensor, Tensor]]) -> tuple[Tensor, Tensor]:
    """Index `[n, M]` and weights `[n, M, C]` of all parts, padded to the widest."""
    slots = max(index.shape[1] for index, _ in parts)
    pad = torch.nn.functional.pad
    index = [pad(index, (0, slots - index.shape[1]), value=-1) for index, _ in parts]
    weights = [pad(part, (0, 0, 0, slots - part.shape[1])) for _, part in parts]
    return torch.cat(index), torch.cat(weights)
