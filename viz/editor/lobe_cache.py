"""Values of lobes at the hits of a picture, kept while edits change other things.

An edit of weights then costs one sparse weighted sum; an edit of lobes evaluates only the lobes
that it changed.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import torch
from torch import Tensor
from torch.nn import functional

from ...lobes.batch import LobeBatch
from ...lobes.pairs import eval_pairs
from ...model.spmm import SPMM

# Pairs evaluated between two checks whether to stop: some ten milliseconds.
BLOCK_PAIRS = 1 << 18


class Stopped(Exception):
    """An evaluation was stopped because its result is out of date."""


def never() -> bool:
    """The check of an evaluation that is never stopped."""
    return False


@dataclass(frozen=True)
class Pairs:
    """Every (hit, entry) pair, hit by hit.

    Attributes:
        offset, index: entries of the model that the pairs were made for.
        start: where the pairs of each of P hits begin, `[P]`.
        hit, entry, lobe: of each pair, `[E]`.
        texel_weight: weight of each pair's texel in its hit, `[E]`.
    """

    offset: Tensor
    index: Tensor
    start: Tensor
    hit: Tensor
    entry: Tensor
    lobe: Tensor
    texel_weight: Tensor

    @classmethod
    def build(cls, model: SPMM, texel: Tensor, texel_weight: Tensor) -> Pairs:
        """The pairs of hits on texels `[P, n]` with weights `[P, n]`."""
        first = model.offset[texel].flatten()
        count = model.offset[texel + 1].flatten() - first
        begin = count.cumsum(0) - count  # [P * n]
        place = torch.repeat_interleave(count)  # [E]
        entry = torch.arange(len(place), device=place.device) + (first - begin)[place]
        hit = torch.div(place, texel.shape[1], rounding_mode="floor")
        start = begin[:: texel.shape[1]]
        lobe = model.index[entry]
        weight = texel_weight.flatten()[place]
        return cls(model.offset, model.index, start, hit, entry, lobe, weight)

    def fits(self, model: SPMM) -> bool:
        """Whether a model has the same entries, whatever their weights and lobes."""
        return _same(self.offset, model.offset) and _same(self.index, model.index)


@dataclass(frozen=True)
class Evaluated:
    """The result of the last evaluation.

    Attributes:
        pairs: that were evaluated.
        lobes: the dictionary at that time.
        rho: value of each pair's lobe, `[E]`.
    """

    pairs: Pairs
    lobes: LobeBatch
    rho: Tensor

    def changed(self, lobes: LobeBatch) -> Tensor:
        """Whether each pair's lobe is another one in `lobes`, `[E]`; all if their number is."""
        kept = self.lobes
        if len(kept) != len(lobes):
            return torch.ones_like(self.pairs.lobe, dtype=torch.bool)
        differs = (lobes.model != kept.model).to(lobes.angle.device) | (lobes.angle != kept.angle)
        differs = differs | (lobes.kappa != kept.kappa).any(1)
        return (differs | (lobes.normal != kept.normal).any(1))[self.pairs.lobe]


class LobeCache:
    """rho_j of all pairs under one light and view.

    Args:
        texel, texel_weight: n texels of each of P hits and their weights, `[P, n]`.
        wi, wo: local directions, `[P, 3]`.
    """

    def __init__(self, texel: Tensor, texel_weight: Tensor, wi: Tensor, wo: Tensor) -> None:
        self.texel, self.texel_weight, self.wi, self.wo = texel, texel_weight, wi, wo
        self._kept: Evaluated | None = None

    def stale(self, model: SPMM) -> int:
        """The number of pairs that `values` has to evaluate; all if the model's entries changed."""
        if self._kept is None or not self._kept.pairs.fits(model):
            counts = model.offset[self.texel + 1] - model.offset[self.texel]
            return int(counts.sum())
        return int(self._kept.changed(model.dictionary).sum())

    @torch.no_grad()
    def values(self, model: SPMM, stop: Callable[[], bool] = never) -> Tensor:
        """The sum of each hit's lobes, sum_j alpha_j rho_j [WDR11 Eq. 2]: `[P, C]`.

        Raises:
            Stopped: `stop` returned True; the cache stays as it was.
        """
        self._kept = self._refreshed(model, stop)
        pairs = self._kept.pairs
        return functional.embedding_bag(
            pairs.entry,
            model.weight,
            pairs.start,
            mode="sum",
            per_sample_weights=self._kept.rho * pairs.texel_weight,
        )

    def _refreshed(self, model: SPMM, stop: Callable[[], bool]) -> Evaluated:
        """The values for a model; only changed lobes are evaluated."""
        lobes = model.dictionary.detach()
        if self._kept is None or not self._kept.pairs.fits(model):
            pairs = Pairs.build(model, self.texel, self.texel_weight)
            where = torch.arange(len(pairs.lobe), device=pairs.lobe.device)
            rho = self.wi.new_zeros(len(where))
        else:
            pairs, rho = self._kept.pairs, self._kept.rho
            where = torch.nonzero(self._kept.changed(lobes)).squeeze(-1)
        if len(where):
            rho = rho.index_copy(0, where, self._evaluate(pairs, lobes, where, stop))
        return Evaluated(pairs, lobes, rho)

    def _evaluate(
        self, pairs: Pairs, lobes: LobeBatch, where: Tensor, stop: Callable[[], bool]
    ) -> Tensor:
        """rho `[E']` of the pairs at `where [E']`."""
        parts = []
        for block in where.split(BLOCK_PAIRS):
            if stop():
                raise Stopped
            parts.append(eval_pairs(lobes, pairs.lobe[block], pairs.hit[block], self.wi, self.wo))
        return torch.cat(parts)


def _same(a: Tensor, b: Tensor) -> bool:
    """Whether two tensors are equal; tensors of one storage need no comparison."""
    return a.shape == b.shape and (a.data_ptr() == b.data_ptr() or torch.equal(a, b))
