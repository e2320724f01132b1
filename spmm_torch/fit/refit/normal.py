"""The normal matrix of all weights: which entries of near texels show in the same pixels.

N[(q, j), (q', j')] = sum_v (W_v^T W_v)[q, q'] <rho_j(v, .), rho_j'(v, .)>. A pixel shows a block of
2 x 2 texels, whatever the relief, so q' is one of the 3 x 3 texels around q.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from ...lobes.ragged import ranges
from ...model.lookup import SparseWeights
from ...runtime.memory import slices
from ...runtime.sparse import csr_matrix
from .lookups import HALF, Lookups
from .matrices import products_at

# Place of a texel itself among the 3 x 3 around it.
SELF = 4
# Pairs of entries whose places are held at once: some 30 MB on a CPU. A GPU launches less often.
PAIR_BLOCK, CUDA_PAIR_BLOCK = 1 << 18, 1 << 20
# Bytes of the products of lobes, pair by pair and view by view, that are held at once.
PRODUCT_BYTES, CUDA_PRODUCT_BYTES = 1 << 27, 1 << 28
# Views whose products are transposed at once: what lies there twice is a fraction of all.
VIEW_BLOCK = 8


@dataclass(frozen=True)
class NormalMatrix:
    """N of all entries.

    Attributes:
        matrix: sparse CSR `[N, N]`.
        diagonal: `[N]`.
    """

    matrix: Tensor
    diagonal: Tensor


def normal_matrix(entries: SparseWeights, rho: Tensor, lookups: Lookups) -> NormalMatrix:
    """N of the entries of all texels.

    Args:
        entries: lobes of all texels; weights are not read.
        rho: values of the lobes, `[V, J, L]`.
        lookups: what each pixel shows.
    """
    count = entries.offset[1:] - entries.offset[:-1]
    sides = torch.arange(9, device=count.device)
    if not lookups.mixed:  # each texel shows in its own pixels only
        sides = sides[SELF : SELF + 1]
    around = neighbours(lookups.height, lookups.width, count.device)[:, sides]  # [T, S]
    lines = count[around].sum(1)  # columns of each row of a texel
    rows = torch.repeat_interleave(lines, count)  # [N]
    start = torch.cat((rows.new_zeros(1), rows.cumsum(0)))
    column = torch.empty(int(start[-1]), dtype=torch.int32, device=count.device)
    value = torch.zeros(len(column), device=count.device)
    own = torch.zeros(len(entries.index), device=count.device)
    blocks = _blocks(lines * count)
    for views in slices(len(rho), _views_at_once(rho)):
        gram, table = _lobe_products(rho[views]), _squares(lookups, views)
        for texels in blocks:
            pairs = _Pairs.of(entries, rho.shape[1], around, sides, texels)
            if not len(pairs.other):
                continue
            part = slice(int(start[pairs.first]), int(start[pairs.last]))
            found = pairs.sums(table, gram)
            column[part] = pairs.other.int()
            value[part] += found
            entry = pairs.group.div(len(sides), rounding_mode="floor")
            diagonal = torch.nonzero(pairs.other == pairs.first + entry).squeeze(1)
            own.index_add_(0, pairs.other[diagonal], found[diagonal])
    size = len(entries.index)
    matrix = csr_matrix(start.int(), column, value, (size, size))
    return NormalMatrix(matrix, own)


@dataclass(frozen=True)
class _Pairs:
    """Entries `first` to `last` of some texels, each with all entries of the texels around its own.

    Attributes:
        first, last: entries.
        group: entry of `first` to `last` and side of the other, as one number, `[n]`.
        other: the other entry, `[n]`.
        lobes: of both, as one number, `[n]`.
        end: number of pairs before each group, `[G + 1]`.
        place: of both texels in the table of W_v^T W_v, `[G]`.
    """

    first: int
    last: int
    group: Tensor
    other: Tensor
    lobes: Tensor
    end: Tensor
    place: Tensor

    @classmethod
    def of(
        cls, entries: SparseWeights, lobe_count: int, around: Tensor, sides: Tensor, texels: slice
    ) -> _Pairs:
        """The pairs of consecutive texels, each of which has texels `around [T, S]` at `sides`."""
        first, last = int(entries.offset[texels.start]), int(entries.offset[texels.stop])
        count = entries.offset[1:] - entries.offset[:-1]
        texel = torch.repeat_interleave(count[texels]) + texels.start  # of each entry
        near = around[texel]  # [e, S]
        length = count[near].flatten()  # [G]
        group, other = ranges(entries.offset[near].flatten(), length)
        own = entries.index[first:last].repeat_interleave(len(sides))  # [G]
        lobes = own[group] * lobe_count + entries.index[other]
        end = torch.cat((length.new_zeros(1), length.cumsum(0)))
        place = _square_place(texel[:, None], near, sides).flatten()
        return cls(first, last, group, other, lobes, end, place)

    def sums(self, table: Tensor, gram: Tensor) -> Tensor:
        """sum_v (W_v^T W_v)[q, q'] <rho_j(v), rho_j'(v)> over some views, `[n]`.

        Args:
            table: W_v^T W_v, `[T 5, v]`.
            gram: products of the lobes, `[J J, v]`.
        """
        values = torch.empty(len(self.lobes), device=gram.device)
        shape = (len(self.place), len(gram))
        pattern = csr_matrix(self.end.int(), self.lobes.int(), values, shape)
        return products_at(pattern, table[self.place], gram.T)


def _views_at_once(rho: Tensor) -> int:
    size = CUDA_PRODUCT_BYTES if rho.is_cuda else PRODUCT_BYTES
    return max(size // (4 * rho.shape[1] ** 2), 1)


def _lobe_products(rho: Tensor) -> Tensor:
    """<rho_j(v), rho_j'(v)> `[J J, v]` of values `[v, J, L]`."""
    products = torch.empty(rho.shape[1] ** 2, len(rho), device=rho.device)
    for views in slices(len(rho), VIEW_BLOCK):
        products[:, views] = (rho[views] @ rho[views].transpose(1, 2)).flatten(1).T
    return products


def _squares(lookups: Lookups, views: slice) -> Tensor:
    """W_v^T W_v of some views, `[T 5, v]`."""
    count, device = views.stop - views.start, lookups.texel.device
    table = torch.empty(lookups.texel.shape[1] * len(HALF), count, device=device)
    for run in slices(count, count if table.is_cuda else VIEW_BLOCK):  # launches cost more there
        here = slice(views.start + run.start, views.start + run.stop)
        table[:, run] = lookups.squares(here).flatten(1).T
    return table


def neighbours(height: int, width: int, device: torch.device) -> Tensor:
    """The 3 x 3 texels around each texel, `[T, 9]`, row by row; the texture repeats."""
    step = torch.arange(-1, 2, device=device)
    row = (torch.arange(height, device=device)[:, None] + step) % height  # [H, 3]
    column = (torch.arange(width, device=device)[:, None] + step) % width  # [W, 3]
    index = row[:, None, :, None] * width + column[None, :, None, :]  # [H, W, 3, 3]
    return index.view(height * width, 9)


def _square_place(texel: Tensor, other: Tensor, side: Tensor) -> Tensor:
    """Place in the table `[T 5]` of W_v^T W_v, of a texel and its neighbour at `side`."""
    after = side >= SELF
    slot = (side - SELF).abs()
    return torch.where(after, texel, other) * len(HALF) + slot


def _blocks(sizes: Tensor) -> list[slice]:
    """Consecutive texels whose `sizes [T]` sum to about a block of pairs."""
    block = (sizes.cumsum(0) - sizes) // (CUDA_PAIR_BLOCK if sizes.is_cuda else PAIR_BLOCK)
    ends = torch.nonzero(block[1:] != block[:-1]).squeeze(1).add(1).tolist()
    edges = [0, *ends, len(sizes)]
    return [slice(a, b) for a, b in zip(edges[:-1], edges[1:], strict=True)]
