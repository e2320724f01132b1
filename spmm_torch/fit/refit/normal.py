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

# Place of a texel itself among the 3 x 3 around it.
SELF = 4
# Pairs of entries whose products are summed at once: 64 MB for 16 views.
PAIR_BLOCK = 1 << 19
# Views whose products of lobes are held at once.
VIEW_BLOCK = 16


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
    squares = lookups.squares()  # [V, T, 5]
    sides = torch.arange(9, device=count.device)
    if not lookups.mixed:  # each texel shows in its own pixels only
        sides = sides[SELF : SELF + 1]
    around = neighbours(lookups.height, lookups.width, count.device)[:, sides]  # [T, S]
    length = count[around]  # [T, S]
    lines = length.sum(1)  # columns of each row of a texel
    rows = torch.repeat_interleave(lines, count)  # [N]
    start = torch.cat((rows.new_zeros(1), rows.cumsum(0)))
    column = torch.empty(int(start[-1]), dtype=torch.int32, device=count.device)
    value = torch.zeros(len(column), device=count.device)
    own = torch.zeros(len(entries.index), device=count.device)
    for texels in _blocks(lines * count):
        first, last = int(entries.offset[texels.start]), int(entries.offset[texels.stop])
        if last == first:
            continue
        texel = torch.repeat_interleave(count[texels]) + texels.start  # of each entry [n]
        group, other = ranges(entries.offset[around[texel]].flatten(), length[texel].flatten())
        entry = group.div(len(sides), rounding_mode="floor")
        side = group % len(sides)
        lobe, mate = entries.index[first + entry], entries.index[other]
        place = _square_place(texel[entry], around[texel[entry], side], sides[side])
        part = slice(int(start[first]), int(start[last]))
        column[part] = other.int()
        value[part] = _sums(rho, squares, lobe, mate, place)
        diagonal = torch.nonzero(other == first + entry).squeeze(1)
        own.index_add_(0, other[diagonal], value[part][diagonal])
    size = len(entries.index)
    matrix = csr_matrix(start.int(), column, value, (size, size))
    return NormalMatrix(matrix, own)


def neighbours(height: int, width: int, device: torch.device) -> Tensor:
    """The 3 x 3 texels around each texel, `[T, 9]`, row by row; the texture repeats."""
    step = torch.arange(-1, 2, device=device)
    row = (torch.arange(height, device=device)[:, None] + step) % height  # [H, 3]
    column = (torch.arange(width, device=device)[:, None] + step) % width  # [W, 3]
    index = row[:, None, :, None] * width + column[None, :, None, :]  # [H, W, 3, 3]
    return index.view(height * width, 9)


def _square_place(texel: Tensor, other: Tensor, side: Tensor) -> Tensor:
    """Place `[n]` in the table `[T 5]` of W_v^T W_v, of a texel and its neighbour at `side`."""
    after = side >= SELF
    slot = (side - SELF).abs()
    return torch.where(after, texel, other) * len(HALF) + slot


def _sums(rho: Tensor, squares: Tensor, lobe: Tensor, mate: Tensor, place: Tensor) -> Tensor:
    """sum_v squares[v, place] <rho_lobe(v), rho_mate(v)>, `[n]`."""
    lobes = rho.shape[1]
    total = torch.zeros(len(lobe), device=rho.device)
    for views in slices(len(rho), VIEW_BLOCK):
        gram = rho[views] @ rho[views].transpose(1, 2)  # [v, J, J]
        gram = gram.flatten(1).T.contiguous()  # [J J, v]
        table = squares[views].flatten(1).T.contiguous()  # [T 5, v]
        for part in slices(len(lobe), PAIR_BLOCK):
            shared = table.index_select(0, place[part])
            shared *= gram.index_select(0, lobe[part] * lobes + mate[part])
            total[part] += shared.sum(1)
    return total


def _blocks(sizes: Tensor) -> list[slice]:
    """Consecutive texels whose `sizes [T]` sum to about two blocks of pairs."""
    block = (sizes.cumsum(0) - sizes) // (2 * PAIR_BLOCK)
    ends = torch.nonzero(block[1:] != block[:-1]).squeeze(1).add(1).tolist()
    edges = [0, *ends, len(sizes)]
    return [slice(a, b) for a, b in zip(edges[:-1], edges[1:], strict=True)]
