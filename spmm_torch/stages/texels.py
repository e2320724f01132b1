"""Stages select, refit and residual over all texels, one cluster at a time [WDR11 §4.1]."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import torch
from torch import Tensor

from ..checkpoint import Checkpoint
from ..config import FitConfig
from ..data import BTF
from ..memory import slices
from ..metrics import Totals
from ..ranks import Ranks
from ..stopwatch import Stopwatch
from ..weights import UNIFORM, Weights
from .cluster import Advance, block_texels
from .dictionary import Dictionary
from .exact import exact_where_doubtful
from .missing import MissingPairs
from .products import Load, cluster_products
from .select import (
    Fit,
    Products,
    refit,
    residual_share,
    select,
    squared_errors,
    taken_by_residual,
    target_beside_residual,
)
from .tally import Tally, WeightedTally, tally_uniform

# Texels that are selected for at once, so that the sums over their atoms take little memory; the
# same whatever memory there is.
CPU_TEXELS, CUDA_TEXELS = 1 << 11, 1 << 16
# Share of the energy that rounding in float32 may leave of texels that their mean fits exactly.
ROUNDING = 1e-6
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
        dictionary: all lobes.
        config: of the fit.
        watch: tells the time by stage.
        spare: bytes that the products of a cluster may take in memory.
        ranks: that share the texels of every cluster.
        weights: of texels and pairs.
        gaps: how the residual of missing pairs is found; None without any.
    """

    btf: BTF
    dictionary: Dictionary
    config: FitConfig
    watch: Stopwatch
    spare: int
    ranks: Ranks
    weights: Weights = UNIFORM
    gaps: MissingPairs | None = None


def fit_texels(
    setting: Setting, members: list[Tensor], checkpoint: Checkpoint, advance: Advance
) -> list[ClusterFit]:
    """Fits the texels of every cluster with the lobes open to it, and their residual."""
    fits = []
    for cluster, texels in enumerate(members):
        fits.append(
            checkpoint.once(
                f"texels-{cluster:04d}",
                ClusterFit,
                lambda cluster=cluster, texels=texels: _fit_cluster(setting, cluster, texels),
            )
        )
        advance(len(texels))
    return fits


def _fit_cluster(setting: Setting, cluster: int, texels: Tensor) -> ClusterFit:
    dictionary, watch, ranks = setting.dictionary, setting.watch, setting.ranks
    where = dictionary.choices[cluster].to(dictionary.atoms.device)
    atoms = dictionary.atoms[where]
    own = ranks.share(texels)
    with watch("select"):
        products = _products(setting, own, atoms, setting.weights)
    fit = ClusterProblem(products, setting.config, watch, ranks).solve()
    with watch("residual"):
        tally = _tally(setting, own, where, products, fit)
    index, weights = _joined([pair for part in ranks.gather(fit.on_cpu()) for pair in part])
    lobe = torch.where(index >= 0, where.cpu()[index.clamp(min=0)], -1)  # [n, M]
    weights = weights / dictionary.norm.cpu()[lobe.clamp(min=0)][..., None]
    return ClusterFit(lobe, weights, tally.code, tally.scale, tally.totals, tally.weighted)


def _passes(
    setting: Setting, texels: Tensor, device: torch.device, weights: Weights
) -> tuple[Load, list[slice]]:
    """How to load some of `texels`, scaled by weights, and in which blocks."""
    btf = setting.btf
    blocks = list(slices(len(texels), block_texels(btf, device)))
    return lambda part: weights.values(btf, texels[part], device), blocks


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
    blocks = list(zip(_blocks(products), fit.fits, strict=True))
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
        in_memory=size <= setting.spare,
        ranks=setting.ranks,
        importance=weights.of_texels(texels, atoms.device),
    )


def _blocks(products: Products) -> list[slice]:
    """Blocks of texels that are selected for at once."""
    size = CUDA_TEXELS if products.gram.device.type == "cuda" else CPU_TEXELS
    return list(slices(len(products.energy), size))


def _joined(parts: list[tuple[Tensor, Tensor]]) -> tuple[Tensor, Tensor]:
    """Index `[n, M]` and weights `[n, M, C]` of all parts, padded to the longest."""
    slots = max(index.shape[1] for index, _ in parts)
    pad = torch.nn.functional.pad
    index = [pad(index, (0, slots - index.shape[1]), value=-1) for index, _ in parts]
    weights = [pad(part, (0, 0, 0, slots - part.shape[1])) for _, part in parts]
    return torch.cat(index), torch.cat(weights)


@dataclass(frozen=True)
class Solution:
    """The fits of this rank's texels, and what they make of the whole cluster.

    Attributes:
        fits: block by block.
        mean: weight of every atom, mean over the cluster, `[J, C]` float64.
        error: squared error of the lobes alone.
        taken: how much of it the residual takes away.
    """

    fits: list[Fit]
    mean: Tensor
    error: float
    taken: float

    def on_cpu(self) -> list[tuple[Tensor, Tensor]]:
        """Index and weights of every block."""
        return [(fit.index.cpu(), fit.weights.cpu()) for fit in self.fits]


@dataclass(frozen=True)
class ClusterProblem:
    """The sparse fit of one cluster; its texels are independent but for their residual."""

    products: Products
    config: FitConfig
    watch: Stopwatch
    ranks: Ranks

    def solve(self) -> Solution:
        """Fits the lobes alone, then, if settings want it, again beside the residual.

        If even so the residual leaves more error than the bare mean of the cluster, the weights
        are fit to the deviations from that mean: from there every turn can only improve.
        """
        products = self.products
        found = self._solution(self._each("select", self._select(None, 0.0)))
        if not self.config.residual.joint:
            return found
        share = residual_share(found.error, found.taken, products.effective)
        found = self._alternate(found.mean, share)
        energy = float(self.ranks.sum(products.total(products.energy)))
        of_mean = energy - products.count * float(products.mean_energy.sum())
        if found.error - found.taken > of_mean + ROUNDING * energy:
            found = self._alternate(None, 1.0)
        return found

    def _alternate(self, mean: Tensor | None, share: float) -> Solution:
        """Selects beside the residual that `mean` weights leave, then fits both in turn."""
        found = self._solution(self._each("select", self._select(mean, share)))
        for _ in range(self.config.residual.alternations):
            found = self._solution(self._each("refit", self._refit(found, share)))
        return found

    def _select(self, mean: Tensor | None, share: float) -> Callable[[int, Products], Fit]:
        def step(_: int, part: Products) -> Fit:
            target = target_beside_residual(part, mean, share)
            return select(part, target, self.config.select, self.config.stagewise)

        return step

    def _refit(self, found: Solution, share: float) -> Callable[[int, Products], Fit]:
        def step(block: int, part: Products) -> Fit:
            target = target_beside_residual(part, found.mean, share)
            return refit(part, found.fits[block], target)

        return step

    def _each(self, stage: str, step: Callable[[int, Products], Fit]) -> list[tuple[Fit, float]]:
        """A step of a stage on every block of texels: its fit, and the error that this leaves."""
        results = []
        for block, texels in enumerate(_blocks(self.products)):
            part = self.products.part(texels)
            with self.watch(stage):
                fit = step(block, part)
            with self.watch("evaluate"):
                results.append((fit, float(part.total(squared_errors(part, fit)))))
        return results

    def _solution(self, results: list[tuple[Fit, float]]) -> Solution:
        """What the fits of all blocks on all ranks make together."""
        atoms, channels = self.products.mean_correlation.shape
        total = torch.zeros(atoms, channels, dtype=torch.float64, device=self.products.gram.device)
        for texels, (fit, _) in zip(_blocks(self.products), results, strict=True):
            own = self.products.importance
            total += fit.total_weights(atoms, None if own is None else own[texels])
        mean = self.ranks.sum(total) / self.products.count
        own = torch.tensor(sum(error for _, error in results), dtype=torch.float64)
        error = float(self.ranks.sum(own))
        taken = taken_by_residual(self.products, mean)
        return Solution([fit for fit, _ in results], mean, error, taken)
