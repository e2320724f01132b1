"""Values of lobes at the hits of a picture, kept while edits change other things.

An edit of weights then costs one sparse weighted sum; an edit of lobes evaluates those anew that it
changed, and no others.
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

# Pairs between two questions whether to stop: some ten milliseconds.
BLOCK = 1 << 18


class Stopped(Exception):
    """An evaluation was given up because its result is not wanted any more."""


def never() -> bool:
    """Goes on to the end."""
    return False


@dataclass(frozen=True)
class Pairs:
    """Every (hit, entry) pair, hit by hit.

    Attributes:
        offset, index: those of the model that the pairs were made for.
        start: where the pairs of each of P hits begin, `[P]`.
        hit, entry, lobe: of each pair, `[E]`.
        share: what each pair counts, `[E]`.
    """

    offset: Tensor
    index: Tensor
    start: Tensor
    hit: Tensor
    entry: Tensor
    lobe: Tensor
    share: Tensor

    @classmethod
    def build(cls, model: SPMM, texel: Tensor, share: Tensor) -> Pairs:
        """The pairs of hits on texels `[P, n]` by their shares `[P, n]`."""
        first = model.offset[texel].flatten()
        count = model.offset[texel + 1].flatten() - first
        begin = count.cumsum(0) - count  # [P * n]
        place = torch.repeat_interleave(count)  # [E]
        entry = torch.arange(len(place), device=place.device) + (first - begin)[place]
        hit = torch.div(place, texel.shape[1], rounding_mode="floor")
        start = begin[:: texel.shape[1]]
        lobe = model.index[entry]
        return cls(model.offset, model.index, start, hit, entry, lobe, share.flatten()[place])

    def fits(self, model: SPMM) -> bool:
        """Whether a model has the same entries, whatever their weights and lobes."""
        return _same(self.offset, model.offset) and _same(self.index, model.index)


class LobeCache:
    """rho_j of all pairs under one light and view.

    Args:
        texel, share: n texels of each of P hits and their weights, `[P, n]`.
        wi, wo: local directions, `[P, 3]`.
    """

    def __init__(self, texel: Tensor, share: Tensor, wi: Tensor, wo: Tensor) -> None:
        self.texel, self.share, self.wi, self.wo = texel, share, wi, wo
        self._pairs: Pairs | None = None
        self._lobes: LobeBatch | None = None
        self._rho: Tensor | None = None

    def stale(self, model: SPMM) -> int:
        """How many pairs `values` would have to evaluate; all of them count for a new structure."""
        if self._pairs is None or not self._pairs.fits(model):
            counts = model.offset[self.texel + 1] - model.offset[self.texel]
            return int(counts.sum())
        return int(self._changed(model.dictionary).sum())

    @torch.no_grad()
    def values(self, model: SPMM, stop: Callable[[], bool] = never) -> Tensor:
        """The sum of each hit's lobes, sum_j alpha_j rho_j [WDR11 Eq. 2]: `[P, C]`.

        Raises:
            Stopped: `stop` said so; what was kept before is kept still.
        """
        self._refresh(model, stop)
        return functional.embedding_bag(
            self._pairs.entry,
            model.weight,
            self._pairs.start,
            mode="sum",
            per_sample_weights=self._rho * self._pairs.share,
        )

    def _refresh(self, model: SPMM, stop: Callable[[], bool]) -> None:
        """Evaluates what changed since the last call."""
        lobes = model.dictionary.detach()
        if self._pairs is None or not self._pairs.fits(model):
            pairs = Pairs.build(model, self.texel, self.share)
            where = torch.arange(len(pairs.lobe), device=pairs.lobe.device)
            rho = self.wi.new_zeros(len(where))
        else:
            pairs, rho = self._pairs, self._rho
            where = torch.nonzero(self._changed(lobes)).squeeze(-1)
        if len(where):
            rho = rho.index_copy(0, where, self._evaluate(pairs, lobes, where, stop))
        self._pairs, self._rho, self._lobes = pairs, rho, lobes

    def _changed(self, lobes: LobeBatch) -> Tensor:
        """Whether each pair's lobe differs from the kept one, `[E]`; always, in number."""
        kept = self._lobes
        if len(kept) != len(lobes):
            return torch.ones_like(self._pairs.lobe, dtype=torch.bool)
        differs = (lobes.model != kept.model).to(lobes.angle.device) | (lobes.angle != kept.angle)
        differs = differs | (lobes.kappa != kept.kappa).any(1)
        return (differs | (lobes.normal != kept.normal).any(1))[self._pairs.lobe]

    def _evaluate(
        self, pairs: Pairs, lobes: LobeBatch, where: Tensor, stop: Callable[[], bool]
    ) -> Tensor:
        """rho `[E']` of the pairs at `where [E']`."""
        parts = []
        for block in where.split(BLOCK):
            if stop():
                raise Stopped
            parts.append(eval_pairs(lobes, pairs.lobe[block], pairs.hit[block], self.wi, self.wo))
        return torch.cat(parts)


def _same(a: Tensor, b: Tensor) -> bool:
    """Whether two tensors are equal; those of one storage are without a look."""
    return a.shape == b.shape and (a.data_ptr() == b.data_ptr() or torch.equal(a, b))
