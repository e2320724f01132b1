"""Bilinear lookup in a sparse texture, by blocks of 2 x 2 texels.

Neighbouring texels share most of their lobes. A block lists each lobe of its four texels once, with
the weight that each texel gives it, so a query between the texels evaluates each lobe once.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor
from torch.nn.functional import embedding_bag

from ..geometry.directions import continued
from ..lobes.batch import LobeBatch
from ..lobes.pairs import PairRows, eval_rows
from ..lobes.ragged import COUNTED, ranges, run_starts, stable_order


@dataclass(frozen=True)
class SparseWeights:
    """Lobes and weights of every texel, without padding.

    Attributes:
        offset: where each texel's entries start, `[T + 1]` long.
        index: lobe of each entry, `[N]` long.
        weight: alpha of each entry, `[N, C]`.
    """

    offset: Tensor
    index: Tensor
    weight: Tensor

    def of(self, texels: Tensor) -> SparseWeights:
        """The entries of `texels [n]`, in their order."""
        count = self.offset[texels + 1] - self.offset[texels]
        _, entry = ranges(self.offset[texels], count)
        offset = torch.cat((count.new_zeros(1), count.cumsum(0)))
        return SparseWeights(offset, self.index[entry], self.weight[entry])


@dataclass(frozen=True)
class BlockLobes:
    """The lobes of blocks of texels, each once a block.

    Attributes:
        texel: the n texels of each block, `[B, n]`; four for bilinear lookups.
        start, count: first entry and number of entries of each block, `[B]`.
        lobe: lobe of each entry, `[M]`.
    """

    texel: Tensor
    start: Tensor
    count: Tensor
    lobe: Tensor


@dataclass(frozen=True)
class MergedEntries(BlockLobes):
    """The lobes of blocks without their weights.

    Attributes:
        entry: entries of the texture that are merged, `[E]`.
        place: n times the merged entry of each of them, plus its corner, `[E]`.
    """

    entry: Tensor
    place: Tensor

    @classmethod
    def build(
        cls, texel: Tensor, counts: Tensor | None, offset: Tensor, index: Tensor
    ) -> MergedEntries:
        """Merges the lobes of each block.

        Args:
            texel: the n texels of each block, `[B, n]`.
            counts: whether a texel is needed, `[B, n]` bool; the lobes of others are left out.
                None: all are.
            offset, index: of the entries of the texture, as in `SparseWeights`.
        """
        flat = texel.flatten()
        start = offset[flat]
        length = offset[flat + 1] - start
        corner, entry = ranges(start, length if counts is None else length * counts.flatten())
        corners = texel.shape[1]
        block, lobe = corner.div(corners, rounding_mode="floor"), index[entry]  # [E]
        order = _by_block_and_lobe(block, lobe, len(texel))
        corner, entry, block, lobe = (x[order] for x in (corner, entry, block, lobe))
        new = run_starts(block, lobe)
        count = torch.bincount(block[new], minlength=len(texel))
        place = corners * (new.cumsum(0) - 1) + corner % corners
        return cls(texel, count.cumsum(0) - count, count, lobe[new], entry, place)

    def weighted(self, weight: Tensor) -> TexelBlocks:
        """The blocks with the weights `[N, C]` of the texture's entries."""
        corners = self.texel.shape[1]
        total = weight.new_zeros(corners * len(self.lobe), weight.shape[1])
        total = total.index_add(0, self.place, weight.index_select(0, self.entry))
        total = total.view(-1, corners, weight.shape[1])
        return TexelBlocks(self.texel, self.start, self.count, self.lobe, total)


@dataclass(frozen=True)
class TexelBlocks(BlockLobes):
    """The lobes of blocks with their weights.

    Attributes:
        weight: alpha of each entry in the texels of its block, `[M, n, C]`.
    """

    weight: Tensor

    @classmethod
    def build(cls, texel: Tensor, counts: Tensor, weights: SparseWeights) -> TexelBlocks:
        """Merges the lobes of each block; see `MergedEntries.build`."""
        merged = MergedEntries.build(texel, counts, weights.offset, weights.index)
        return merged.weighted(weights.weight)

    def sums(
        self, lobes: LobeBatch, block: Tensor, bilinear: Tensor, wi: Tensor, wo: Tensor
    ) -> Tensor:
        """The sum over lobes in Eq. 2 [WDR11] for Q queries, `[Q, C]`.

        Args:
            lobes: the dictionary.
            block: block of each query, ascending, `[Q]`.
            bilinear: weights of its four texels, `[Q, 4]`.
            wi, wo: directions, `[Q, 3]`.
        """
        asked, queries = torch.unique_consecutive(block, return_counts=True)
        count = self.count.index_select(0, asked)
        _, listed = ranges(self.start.index_select(0, asked), count)
        lobe = self.lobe.index_select(0, listed)
        rows, entry = PairRows.of_lists(lobes.model, lobe, count, queries)
        table = self.weight.index_select(0, listed).flatten(1)  # [E, 4 C]
        rho = eval_rows(lobes, rows, wi, wo).to(table.dtype)
        pairs = torch.repeat_interleave(count.int(), queries)  # [Q]
        first = pairs.cumsum(0, dtype=torch.int32) - pairs
        sums = embedding_bag(entry, table, first, mode="sum", per_sample_weights=rho)  # [Q, 4 C]
        return (sums.unflatten(1, (4, -1)) * bilinear[..., None]).sum(dim=1)  # Eq. (2)


def all_blocks(height: int, width: int, rule: str, device: torch.device) -> Tensor:
    """The four texels `[T, 4]` of the block of each first texel, as `directions.texel_at` has them.

    Args:
        height, width: texels of the texture.
        rule: how the texture continues beyond its border, one of `directions.RULES`.
        device: of the result.
    """
    top, left = (torch.arange(n, device=device) for n in (height, width))
    rows, columns = (
        torch.stack((first, continued(first + 1, len(first), rule)), dim=1) for first in (top, left)
    )
    corners = rows[:, None, :, None] * width + columns[None, :, None, :]  # [H, W, 2, 2]
    return corners.view(-1, 4).clone()


def blocks_met(texel: Tensor, texels: int) -> tuple[Tensor, Tensor]:
    """(block of each query `[Q]`, four texels of each block `[B, 4]`), given `texel [Q, 4]`.

    The first texel tells blocks apart. The texture has `texels` of them.
    """
    first = texel[:, 0]
    met = torch.zeros(texels, dtype=torch.bool, device=texel.device)
    met[first] = True
    block = (met.cumsum(0) - 1)[first]
    corners = texel.new_empty(int(met.sum()), 4)
    corners[block] = texel
    return block, corners


def _by_block_and_lobe(block: Tensor, lobe: Tensor, blocks: int) -> Tensor:
    """Positions `[E]` that sort entries by ascending `block [E]`, then by `lobe [E]`."""
    if not len(lobe):
        return block
    lobes = int(lobe.max()) + 1
    if blocks > COUNTED or lobes > COUNTED:
        return torch.argsort(block * lobes + lobe)
    by_lobe = stable_order(lobe, lobes)
    return by_lobe[stable_order(block[by_lobe], blocks)]
