"""Stages select, refit and residual over all texels, cluster by cluster [WDR11 §4.1].

Of a large cluster some texels, the pilot, are first fit with the lobes alone: all choose from the
lobes that those chose, beside the residual that those left.
"""

from __future__ import annotations

from concurrent.futures import CancelledError
from dataclasses import dataclass, field, replace
from threading import Event

import torch
from torch import Tensor

from ...config.fit import FitConfig
from ...data import BTF
from ...data.blocks import block_texels, cpu_block_bytes
from ...data.error_weights import UNIFORM, Weights
from ...metrics import Totals
from ...runtime.checkpoint import Checkpoint, stage_generator
from ...runtime.memory import slices
from ...runtime.ranks import Ranks
from ...runtime.stopwatch import Stopwatch
from ...runtime.threads import side_by_side
from ..cluster import Advance
from ..dictionary import Dictionary
from ..residual.errors import Tally, WeightedTally, tally_uniform
from ..residual.exact import exact_where_doubtful
from ..residual.missing import MissingPairs
from .alternate import CPU_TEXELS, SELECT_BYTES, ClusterProblem, Solution, selection_blocks
from .products import Load, cluster_products
from .texels import Products

# Clusters of more texels than so many pilots have one: in smaller ones it saves little.
PILOTS = 4

PRECISIONS = {"float16": torch.float16, "float32": torch.float32}


@dataclass(frozen=True)
class ClusterFit:
    """The fit of one cluster of n texels.

    Attributes:
        index: lobes of the dictionary `[n, M]`, -1 for padding.
        weights: `[n, M, C]`, of lobes as they are (not of unit norm).
        code: the stored residual `[D, C]`.
        scale: its scale `[]`.
        totals: squared errors of the cluster, over all measured values alike.
        weighted: the same by weight; None where all weights are 1.
    """

    index: Tensor
    weights: Tensor
    code: Tensor
    scale: Tensor
    totals: Totals
    weighted: Totals | None = None

    def to_tensors(self) -> dict[str, Tensor]:
        """For a checkpoint."""
        sums = {"totals": self.totals, "weighted": self.weighted}
        rows = {
            name: torch.tensor(part.row(), dtype=torch.float64)
            for name, part in sums.items()
            if part is not None
        }
        return {name: part for name, part in vars(self).items() if name not in sums} | rows

    @classmethod
    def from_tensors(cls, tensors: dict[str, Tensor]) -> ClusterFit:
        """From a checkpoint."""
        sums = {
            name: Totals(*tensors[name].tolist())
            for name in ("totals", "weighted")
            if name in tensors
        }
        return cls(**{**tensors, **sums})


@dataclass(frozen=True)
class Setting:
    """What the fits of all clusters share.

    Attributes:
        btf: the input.
        points: principal coordinates of the texels, `[T, P]`.
        dictionary: all lobes.
        config: of the fit.
        watch: tells the time by stage.
        spare: bytes that the products of a cluster may take in memory.
        ranks: that share the texels of every cluster.
        weights: of texels and pairs.
        gaps: how the residual of missing pairs is found; None without any.
        stopped: set once the result of a cluster is not wanted any more.
    """

    btf: BTF
    points: Tensor
    dictionary: Dictionary
    config: FitConfig
    watch: Stopwatch
    spare: int
    ranks: Ranks
    weights: Weights = UNIFORM
    gaps: MissingPairs | None = None
    stopped: Event = field(default_factory=Event)


def fit_texels(
    setting: Setting, members: list[Tensor], checkpoint: Checkpoint, advance: Advance
) -> list[ClusterFit]:
    """Fits the texels of every cluster with the lobes open to it, and their residual.

    On a CPU, several clusters at once: most steps are too small to be shared among threads.
    """
    at_once, threads = _clusters_at_once(setting, len(members))
    taken = (at_once - 1) * cluster_bytes(len(setting.dictionary.atoms))
    setting = replace(setting, spare=(setting.spare - taken) // at_once)

    def work(cluster: int, stopped: Event) -> ClusterFit:
        watches[cluster] = watch = setting.watch.one_of(at_once)
        own = replace(setting, watch=watch, stopped=stopped)
        return replace(checkpoint, watch=watch).once(
            f"texels-{cluster:04d}",
            ClusterFit,
            lambda: _fit_cluster(own, cluster, members[cluster]),
        )

    def done(cluster: int) -> None:
        setting.watch.take(watches.pop(cluster))
        advance(len(members[cluster]))

    watches: dict[int, Stopwatch] = {}
    return side_by_side(work, range(len(members)), at_once, threads, done)


def cluster_bytes(atoms: int) -> int:
    """Memory that the fit of one cluster with so many lobes takes on a CPU, products apart."""
    return cpu_block_bytes() + SELECT_BYTES * CPU_TEXELS * atoms


def _clusters_at_once(setting: Setting, clusters: int) -> tuple[int, int]:
    """How many clusters are fit at once, and by how many threads each.

    As many as there are threads, or as memory allows: how many threads work on one does not depend
    on the memory, since sums must round the same. Processes that share every cluster keep step.
    """
    threads, atoms = torch.get_num_threads(), setting.dictionary.atoms
    if atoms.is_cuda or setting.ranks.size > 1:
        return 1, threads
    wanted = min(threads, clusters)
    room = 1 + max(0, setting.spare) // cluster_bytes(len(atoms))
    return min(wanted, room), threads // wanted


def _fit_cluster(setting: Setting, cluster: int, texels: Tensor) -> ClusterFit:
    dictionary, watch, ranks = setting.dictionary, setting.watch, setting.ranks
    where = dictionary.choices[cluster].to(dictionary.atoms.device)
    start, size = None, setting.config.select.pilot
    if size is not None and len(texels) > PILOTS * size:
        some = _pilot(setting, cluster, texels, size)
        start, needed = _problem(setting, some, where).pilot()
        used = torch.nonzero(needed).squeeze(1)
        where, start = where[used], start.of(used)
    own = ranks.share(texels)
    problem = _problem(setting, texels, where)
    fit = problem.solve(start)
    with watch("residual"):
        tally = _tally(setting, own, where, problem.products, fit)
    index, weights = _joined([pair for part in ranks.gather(fit.on_cpu()) for pair in part])
    lobe = torch.where(index >= 0, where.cpu()[index.clamp(min=0)], -1)  # [n, M]
    weights = weights / dictionary.norm.cpu()[lobe.clamp(min=0)][..., None]
    return ClusterFit(lobe, weights, tally.code, tally.scale, tally.totals, tally.weighted)


def _pilot(setting: Setting, cluster: int, texels: Tensor, size: int) -> Tensor:
    """So many of a cluster's texels, at random."""
    generator = stage_generator(setting.config.seed, f"pilot-{cluster}")
    order = torch.randperm(len(texels), generator=generator)
    return texels[order[:size].sort().values]


def _problem(setting: Setting, texels: Tensor, where: Tensor) -> ClusterProblem:
    """The fit of this rank's share of some texels of a cluster with the lobes `where [J]`."""
    ranks, watch = setting.ranks, setting.watch
    with watch("select"):
        atoms = setting.dictionary.atoms[where]
        products = _products(setting, ranks.share(texels), atoms, setting.weights)
    return ClusterProblem(products, setting.config, watch, ranks)


def _passes(
    setting: Setting, texels: Tensor, device: torch.device, weights: Weights
) -> tuple[Load, list[slice]]:
    """How to load some of `texels`, scaled by weights, and in which blocks."""
    btf = setting.btf

    def load(part: slice) -> Tensor:
        if setting.stopped.is_set():
            raise CancelledError
        return weights.signals(btf, texels[part], device)

    return load, list(slices(len(texels), block_texels(btf, device)))


def _tally(
    setting: Setting, texels: Tensor, where: Tensor, products: Products, fit: Solution
) -> Tally:
    """The residual and the errors of the fit of this rank's texels with atoms `where [J]`."""
    atoms = setting.dictionary.atoms[where]
    precision = PRECISIONS[setting.config.residual.precision]
    if setting.weights.uniform:
        errors = (fit.error, fit.taken)
        tally = tally_uniform(products, atoms, fit.mean, errors, precision, setting.ranks)
        passes = _passes(setting, texels, atoms.device, UNIFORM)
        return exact_where_doubtful(tally, passes, fit.fits, atoms, setting.ranks)
    raw, measured = setting.dictionary.raw[where], setting.weights.measured
    measured = None if measured is None else measured.to(raw.device)
    seen = raw if measured is None else raw * measured
    plain = _products(setting, texels, seen, UNIFORM)
    scale = setting.weights.scale(atoms.device)
    weighted = WeightedTally(products, atoms, plain, raw, scale, measured, setting.gaps)
    blocks = list(zip(selection_blocks(products), fit.fits, strict=True))
    return weighted.tally(fit.mean, blocks, precision, setting.ranks)


def _products(setting: Setting, texels: Tensor, atoms: Tensor, weights: Weights) -> Products:
    """The products of this rank's texels of a cluster, in blocks that fit the memory."""
    btf = setting.btf
    size = 4 * len(texels) * len(atoms) * btf.channels
    if not setting.weights.uniform:
        size *= 2  # one with and one without weights
    load, blocks = _passes(setting, texels, atoms.device, weights)
    return cluster_products(
        load,
        blocks,
        (len(texels), btf.channels),
        atoms,
        points=setting.points[texels] if setting.config.residual.joint else None,
        in_memory=size <= setting.spare,
        ranks=setting.ranks,
        importance=weights.of_texels(texels, atoms.device),
    )


def _joined(parts: list[tuple[Tensor, Tensor]]) -> tuple[Tensor, Tensor]:
    """Index `[n, M]` and weights `[n, M, C]` of all parts, padded to the longest."""
    slots = max(index.shape[1] for index, _ in parts)
    pad = torch.nn.functional.pad
    index = [pad(index, (0, slots - index.shape[1]), value=-1) for index, _ in parts]
    weights = [pad(part, (0, 0, 0, slots - part.shape[1])) for _, part in parts]
    return torch.cat(index), torch.cat(weights)
