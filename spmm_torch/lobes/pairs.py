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
from .ragged import ranges, stable_order
from .values import eval_model

# Bounds of the length of a row: short rows repeat the work of a lobe, long rows need more padding.
SHORTEST_ROW, LONGEST_ROW = 8, 128


@dataclass(frozen=True)
class PairRows:
    """N (lobe, query) pairs in G rows of S places; a row holds pairs of one lobe.

    The last pair of a lobe is repeated to fill its last row.

    Attributes:
        lobe: lobe of each row, `[G]`, sorted by model.
        query: query of each place, `[G, S]` whole numbers.
        place: position of each pair among the G * S places, `[N]` whole numbers.
    """

    lobe: Tensor
    query: Tensor
    place: Tensor

    @classmethod
    def build(cls, model: Tensor, lobe: Tensor, query: Tensor) -> PairRows:
        """Rows of pairs `lobe [N]`, `query [N]` of lobes of `model [J]`."""
        by_model, rank = _ranked(model)
        key = rank.index_select(0, lobe)  # [N]
        order = stable_order(key, len(rank))
        count = torch.bincount(key, minlength=len(rank))
        rows, pair, shift = _cut(by_model, count)
        number = torch.arange(len(order), device=order.device)
        place = torch.empty_like(order).scatter_(0, order, number) + shift.index_select(0, key)
        in_order = query.index_select(0, order).index_select(0, pair.flatten())
        return cls(rows, in_order.view_as(pair), place)

    @classmethod
    def of_lists(
        cls, model: Tensor, lobe: Tensor, count: Tensor, queries: Tensor
    ) -> tuple[PairRows, Tensor]:
        """The rows of `build` for queries that share lists of lobes: entries are sorted, not pairs.

        Args:
            model: of the lobes, `[J]`.
            lobe: of each entry, list after list, `[E]`.
            count: entries of each list, `[B]`.
            queries: number of consecutive queries that share it, `[B]`.

        Returns:
            (rows of all pairs, query by query; entry of each pair `[N]` int32).
        """
        by_model, rank = _ranked(model)
        owner = torch.repeat_interleave(count)  # [E]
        key = rank.index_select(0, lobe)
        order = stable_order(key, len(rank))
        rows, pair, shift = _cut(
            by_model, torch.zeros_like(rank).index_add(0, key, queries.index_select(0, owner))
        )
        first_query = queries.cumsum(0) - queries  # [B]
        sorted_owner = owner.index_select(0, order)
        length = queries.index_select(0, sorted_owner)
        start = length.cumsum(0) - length  # of the pairs of each entry, sorted by lobe
        to_query = (first_query.index_select(0, sorted_owner) - start).int()
        run = torch.repeat_interleave(length.int())  # [N]
        number = torch.arange(len(run), dtype=torch.int32, device=run.device)
        in_order = (number + to_query.index_select(0, run)).index_select(0, pair.flatten())
        to_place = torch.empty_like(to_query).scatter_(0, order, -to_query)
        to_place += shift.index_select(0, key).int()
        of_query = torch.repeat_interleave(queries)  # [Q]
        first = (count.cumsum(0) - count).int().index_select(0, of_query)
        query, entry = ranges(first, count.int().index_select(0, of_query))
        return cls(rows, in_order.view_as(pair), query + to_place.index_select(0, entry)), entry

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
    return eval_rows(lobes, PairRows.build(lobes.model, lobe, query), wi, wo, block)


def eval_rows(
    lobes: LobeBatch, rows: PairRows, wi: Tensor, wo: Tensor, block: int | None = None
) -> Tensor:
    """`eval_pairs` of pairs in rows, `[N]`."""
    if not len(rows.place):
        return wi.new_zeros(0)
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
    picked = components.index_select(1, index.flatten())
    return picked.view(3, *index.shape).movedim(0, -1)


def _ranked(model: Tensor) -> tuple[Tensor, Tensor]:
    """Lobes `[J]` in the order of their `model [J]`, and the rank of each in it, `[J]`."""
    by_model = torch.argsort(model, stable=True)
    number = torch.arange(len(model), device=model.device)
    return by_model, torch.empty_like(by_model).scatter_(0, by_model, number)


def _cut(by_model: Tensor, count: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Rows of pairs that are sorted by lobe.

    Args:
        by_model: lobes in the order of their models, `[J]`.
        count: pairs of each of them, `[J]`.

    Returns:
        (lobe of each row `[G]`; number of each pair among the sorted, `[G, S]` int32; what leads
        from that number to the place in the rows, `[J]`).
    """
    total, used = torch.stack((count.sum(), (count > 0).sum())).tolist()
    length = _row_length(total, used)
    rows = (count + length - 1).div(length, rounding_mode="floor")  # [J]
    pair_start, row_start = count.cumsum(0) - count, rows.cumsum(0) - rows
    owner = torch.repeat_interleave(rows)  # [G]
    row = torch.arange(len(owner), device=owner.device) - row_start[owner]
    first = (pair_start[owner] + length * row).int()
    last = (pair_start + count - 1)[owner].int()
    step = torch.arange(length, dtype=torch.int32, device=owner.device)
    pair = torch.minimum(first[:, None] + step, last[:, None])
    return by_model[owner], pair, row_start * length - pair_start


def _row_length(pairs: int, lobes: int) -> int:
    """A power of two near half of the pairs that a lobe has on average."""
    mean = max(1, pairs // max(1, lobes))
    return min(max(1 << (mean.bit_length() - 1), SHORTEST_ROW), LONGEST_ROW)
