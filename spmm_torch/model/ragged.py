"""Eq. 2 by ragged lists: queries sorted by block of texels, and evaluated part by part.

Values are those of each query alone, whatever the parts and threads.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from threading import Event
from typing import TYPE_CHECKING

import torch
from torch import Tensor

from ..lobes.ragged import stable_order
from ..runtime.threads import side_by_side
from .changes import changes
from .lookup import SparseWeights, TexelBlocks, blocks_met

if TYPE_CHECKING:
    from .spmm import SPMM

# (query, lobe) entries that are evaluated at once: enough to outweigh the start of operations.
EVALUATED_ENTRIES = 1 << 19
# Most entries of blocks that are kept from one call to the next: 130 MB of three channels.
KEPT_ENTRIES = 1 << 21


@dataclass(frozen=True)
class KeptBlocks:
    """Blocks of texels that were merged before, for queries that meet no others.

    Attributes:
        state: of the entries of the model then.
        number: number of the block of each first texel, `[T]`; -1 where it has none.
        counts: whether the texels of each block were needed, `[B, 4]` bool.
        blocks: the merged blocks.
    """

    state: tuple[object, ...]
    number: Tensor
    counts: Tensor
    blocks: TexelBlocks

    def number_of(self, corners: Tensor, counts: Tensor) -> Tensor | None:
        """The kept number `[B']` of blocks; None if one is not kept, or of other texels.

        Args:
            corners: texels of the blocks, `[B', 4]`.
            counts: whether each of them is needed, `[B', 4]` bool.
        """
        number = self.number[corners[:, 0]]
        held = (number >= 0) & (self.counts[number] == counts).all(1)
        alike = (self.blocks.texel[number] == corners).all(1)
        return number if bool((held & alike).all()) else None


def values(
    model: SPMM, texel: Tensor, bilinear: Tensor, wi: Tensor, wo: Tensor, *, residual: bool
) -> Tensor:
    """Values `[Q, C]` of texels mixed bilinearly.

    Args:
        model: the model.
        texel, bilinear: four texels of each query and their weights, `[Q, 4]`.
        wi, wo: directions `[Q, 3]`.
        residual: whether to add epsilon.
    """
    block, corners = blocks_met(texel, model.texel_count)
    counts = torch.ones_like(corners, dtype=torch.bool)
    if not bilinear.requires_grad:  # its gradient needs texels of weight 0 too
        counts = bilinear.new_zeros(corners.shape).index_add(0, block, bilinear) > 0.0
    number, blocks = _merged(model, corners, counts, wi.dtype)

    def work(block: Tensor, bilinear: Tensor, wi: Tensor, wo: Tensor) -> Tensor:
        total = blocks.sums(model.dictionary, block, bilinear, wi, wo)
        if residual:
            total = total + model.epsilon(blocks.texel[block], bilinear, wi, wo)  # Eq. (2)
        return total

    return by_parts(work, blocks, block if number is None else number[block], bilinear, wi, wo)


def by_parts(
    work: Callable[[Tensor, Tensor, Tensor, Tensor], Tensor],
    blocks: TexelBlocks,
    block: Tensor,
    bilinear: Tensor,
    wi: Tensor,
    wo: Tensor,
) -> Tensor:
    """`work` of Q queries, `[Q, C]`, which gets some of them at once, sorted by block.

    So neighbours in memory read the same entries. Several parts run at once on a CPU, whose
    operations on one part are too small for many threads.

    Args:
        work: function of the four last arguments of some queries.
        blocks: in which the queries lie.
        block: of each query, `[Q]`.
        bilinear: weights of its four texels, `[Q, 4]`.
        wi, wo: directions `[Q, 3]`.
    """
    order = stable_order(block, len(blocks.count))
    total = max(1, int(blocks.count[block].sum()))
    parts = order.split(max(1, len(block) * EVALUATED_ENTRIES // total))

    def of(part: Tensor, _: Event | None = None) -> Tensor:
        return work(*(given.index_select(0, part) for given in (block, bilinear, wi, wo)))

    workers = min(torch.get_num_threads(), len(parts))
    if workers < 2 or wi.is_cuda or torch.is_grad_enabled():
        done = [of(part) for part in parts]
    else:
        done = side_by_side(of, parts, workers, 1, lambda _: None)
    value = torch.cat(done)
    return torch.empty_like(value).index_copy(0, order, value)


def _merged(
    model: SPMM, corners: Tensor, counts: Tensor, dtype: torch.dtype
) -> tuple[Tensor | None, TexelBlocks]:
    """(numbers of the blocks `[B]`, or None: 0 and so on; the merged blocks).

    They are kept from one call to the next where no gradient is recorded.
    """
    weight = model.weight.to(torch.promote_types(model.weight.dtype, dtype))
    live = torch.is_grad_enabled() and weight.requires_grad
    parts = (model.offset, model.index, model.weight)
    state = (weight.dtype, *((part.data_ptr(), changes(part)) for part in parts))
    kept = model.kept_blocks
    if not live and kept is not None and kept.state == state:
        number = kept.number_of(corners, counts)
        if number is not None:
            return number, kept.blocks
    blocks = TexelBlocks.build(corners, counts, SparseWeights(model.offset, model.index, weight))
    if not live and len(blocks.lobe) <= KEPT_ENTRIES:
        number = corners.new_full((model.texel_count,), -1)
        number[corners[:, 0]] = torch.arange(len(corners), device=corners.device)
        model.kept_blocks = KeptBlocks(state, number, counts, blocks)
    return None, blocks
