"""Stages select, refit and residual over all texels, one cluster at a time [WDR11 §4.1]."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from ..checkpoint import Checkpoint
from ..config import FitConfig
from ..data import BTF
from ..memory import slices
from ..metrics import Totals
from ..ranks import Ranks
from ..residual import decode_residual, encode_residual
from ..stopwatch import Stopwatch
from .cluster import Advance, block_texels
from .dictionary import Dictionary
from .exact import exact_errors, is_doubtful
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
        totals: squared errors of the cluster.
    """

    index: Tensor
    weights: Tensor
    code: Tensor
    scale: Tensor
    totals: Totals

    def to_tensors(self) -> dict[str, Tensor]:
        """For a checkpoint."""
        totals = torch.tensor(self.totals.row(), dtype=torch.float64)
        return {**vars(self), "totals": totals}

    @classmethod
    def from_tensors(cls, tensors: dict[str, Tensor]) -> ClusterFit:
        """From a checkpoint."""
        return cls(**{**tensors, "totals": Totals(*tensors["totals"].tolist())})


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
    """

    btf: BTF
    dictionary: Dictionary
    config: FitConfig
    watch: Stopwatch
    spare: int
    ranks: Ranks


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
    with watch("select"):
        products = _products(setting, ranks.share(texels), atoms)
    fit = ClusterProblem(products, setting.config, watch, ranks).solve()
    with watch("residual"):
        residual = products.mean - atoms.T @ fit.mean.to(atoms.dtype)  # [D, C]
        code, scale = encode_residual(residual[None], PRECISIONS[setting.config.residual.precision])
        stored = decode_residual(code, scale)[0]
        rounding = (stored - residual).double().square().sum()
    energy = float(ranks.sum(products.energy.sum()))
    totals = Totals(
        energy=energy,
        without_residual=fit.error,
        with_residual=max(fit.error - fit.taken, 0.0) + len(texels) * float(rounding),
        cluster_mean=energy - len(texels) * float(products.mean_energy.sum()),
    )
    if is_doubtful(min(totals.without_residual, totals.with_residual), energy):
        with watch("evaluate"):
            totals = _exact_totals(setting, texels, atoms, fit, stored, totals)
    index, weights = _joined([pair for part in ranks.gather(fit.on_cpu()) for pair in part])
    lobe = torch.where(index >= 0, where.cpu()[index.clamp(min=0)], -1)  # [n, M]
    weights = weights / dictionary.norm.cpu()[lobe.clamp(min=0)][..., None]
    return ClusterFit(lobe, weights, code[0].cpu(), scale[0].cpu(), totals)


def _passes(setting: Setting, texels: Tensor, device: torch.device) -> tuple[Load, list[slice]]:
    """How to load some of `texels`, and in which blocks."""
    btf = setting.btf
    blocks = list(slices(len(texels), block_texels(btf, device)))
    return lambda part: btf.texels(texels[part], device), blocks


def _exact_totals(
    setting: Setting,
    texels: Tensor,
    atoms: Tensor,
    fit: Solution,
    residual: Tensor,
    totals: Totals,
) -> Totals:
    """The totals of a cluster whose errors may be rounding, from one more pass."""
    ranks = setting.ranks
    load, blocks = _passes(setting, ranks.share(texels), atoms.device)
    without, with_residual = exact_errors(load, blocks, fit.fits, atoms, residual, ranks)
    return replace(totals, without_residual=without, with_residual=with_residual)


def _products(setting: Setting, texels: Tensor, atoms: Tensor) -> Products:
    """The products of this rank's texels of a cluster, in blocks that fit the memory."""
    btf = setting.btf
    size = 4 * len(texels) * len(atoms) * btf.channels
    load, blocks = _passes(setting, texels, atoms.device)
    return cluster_products(
        load,
        blocks,
        (len(texels), btf.channels),
        atoms,
        in_memory=size <= setting.spare,
        ranks=setting.ranks,
    )


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
        share = residual_share(found.error, found.taken, products.count)
        found = self._alternate(found.mean, share)
        energy = float(self.ranks.sum(products.energy.sum()))
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
        device = self.products.gram.device
        size = CUDA_TEXELS if device.type == "cuda" else CPU_TEXELS
        results = []
        for block, texels in enumerate(slices(len(self.products.energy), size)):
            part = self.products.part(texels)
            with self.watch(stage):
                fit = step(block, part)
            with self.watch("evaluate"):
                results.append((fit, float(squared_errors(part, fit).sum())))
        return results

    def _solution(self, results: list[tuple[Fit, float]]) -> Solution:
        """What the fits of all blocks on all ranks make together."""
        atoms, channels = self.products.mean_correlation.shape
        total = torch.zeros(atoms, channels, dtype=torch.float64, device=self.products.gram.device)
        for fit, _ in results:
            total += fit.total_weights(atoms)
        mean = self.ranks.sum(total) / self.products.count
        own = torch.tensor(sum(error for _, error in results), dtype=torch.float64)
        error = float(self.ranks.sum(own))
        taken = taken_by_residual(self.products, mean)
        return Solution([fit for fit, _ in results], mean, error, taken)
