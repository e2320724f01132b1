"""rho of N (lobe, query) pairs: each lobe at its own directions.

Pairs are sorted by lobe and cut into rows of one length. What depends on the lobe alone is then
computed once a row, and the rest runs over long arrays.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import torch
from torch import Tensor

from .batch import CPU_BLOCK, CUDA_BLOCK, LobeBatch
from .ragged import stable_order
from .values import eval_model

# Bounds of the length of a row: short rows repeat the work of a lobe, long rows need more padding.
SHORTEST_ROW, LONGEST_ROW = 8, 128


@dataclass(frozen=True)
class PairRows:
    """N (lobe, query) pairs in G rows of S places; a row holds pairs of one lobe.

    The last pair of a lobe is repeated to fill its last row.

    Attributes:
        lobe: lobe of each row, `[G]`, sorted by model.
        query: query of each place, `[G, S]`.
        place: position of each pair among the G * S places, `[N]`.
    """

    lobe: Tensor
    query: Tensor
    place: Tensor

    @classmethod
    def build(cls, model: Tensor, lobe: Tensor, query: Tensor) -> PairRows:
        """Rows of pairs `lobe [N]`, `query [N]` of lobes of `model [J]`."""
        by_model = torch.argsort(model, stable=True)  # [J]
        rank = torch.empty_like(by_model)
        rank[by_model] = torch.arange(len(rank), device=rank.device)
        key = rank.index_select(0, lobe)  # [N]
        order = stable_order(key, len(rank))
        count = torch.bincount(key, minlength=len(rank))  # [J], in the order of the models
        length = _row_length(len(lobe), int((count > 0).sum()))
        rows = (count + length - 1).div(length, rounding_mode="floor")  # [J]
        pair_start, row_start = count.cumsum(0) - count, rows.cumsum(0) - rows
        owner = torch.repeat_interleave(rows)  # [G]
        row = torch.arange(len(owner), device=owner.device) - row_start[owner]
        first = pair_start[owner] + length * row
        last = (pair_start + count - 1)[owner]
        step = torch.arange(length, device=owner.device)
        pair = torch.minimum(first[:, None] + step, last[:, None])  # [G, S]
        shift = (row_start * length - pair_start).index_select(0, key)
        number = torch.arange(len(order), device=order.device)
        place = torch.empty_like(order).scatter_(0, order, number)
        in_order = query.index_select(0, order).index_select(0, pair.flatten())
        return cls(by_model[owner], in_order.view_as(pair), place + shift)

    def spread(self, parts: list[Tensor]) -> Tensor:
        """Values `[N]` of the pairs, given those of the rows in blocks `[g, S]`."""
        return torch.cat(parts).flatten().index_select(0, self.place)

    def blocks(self, model: Tensor, block: int | None = None) -> Iterator[tuple[int, slice]]:
        """(model, rows) of blocks of one model.

        Args:
            model: of the lobes, `[J]`.
            block: pairs of one block; default: as many as fit the cache.
        """
        pairs = block or (CUDA_BLOCK if self.lobe.is_cuda else CPU_BLOCK)
        size = max(1, pairs // self.query.shape[1])
        models, counts = torch.unique_consecutive(model[self.lobe], return_counts=True)
        start = 0
        for index, count in zip(models.tolist(), counts.tolist(), strict=True):
            for first in range(start, start + count, size):
                yield index, slice(first, min(first + size, start + count))
            start += count


def eval_pairs(
    lobes: LobeBatch,
    lobe: Tensor,
    query: Tensor,
    wi: Tensor,
    wo: Tensor,
    block: int | None = None,
) -> Tensor:
    """rho of N (lobe, query) pairs [WDR11 Eq. 3].

    Args:
        lobes: J lobes.
        lobe, query: of each pair, `[N]` long.
        wi, wo: directions of Q queries, `[Q, 3]`.
        block: pairs of one block; default: as many as fit the cache.

    Returns:
        `[N]`, in 1/sr.
    """
    if not len(lobe):
        return wi.new_zeros(0)
    rows = PairRows.build(lobes.model, lobe, query)
    wi, wo = wi.T.contiguous(), wo.T.contiguous()  # [3, Q]
    parts = []
    for model, part in rows.blocks(lobes.model, block):
        owner = rows.lobe[part]
        kappa, normal, angle = (
            own.index_select(0, owner) for own in (lobes.kappa, lobes.normal, lobes.angle)
        )
        at = rows.query[part]
        pair = gather(wi, at), gather(wo, at)
        ends = lobes.horizon, lobes.lowest
        parts.append(eval_model(model, kappa, normal, angle, *pair, *ends))
    return rows.spread(parts)


def gather(components: Tensor, index: Tensor) -> Tensor:
    """Directions `[G, S, 3]` of `components [3, Q]` at `index [G, S]`, by contiguous components."""
    flat = index.flatten()
    picked = torch.stack([part.index_select(0, flat) for part in components])
    return picked.view(3, *index.shape).movedim(0, -1)


def _row_length(pairs: int, lobes: int) -> int:
    """A power of two near half of the pairs that a lobe has on average."""
    mean = max(1, pairs // max(1, lobes))
    return min(max(1 << (mean.bit_length() - 1), SHORTEST_ROW), LONGEST_ROW)
