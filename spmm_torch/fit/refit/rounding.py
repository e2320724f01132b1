"""Weights rounded to what a file holds, so that their errors cancel as far as they can.

Each weight alone would go to its nearest place on the scale. Lobes of near texels show in the same
pixels, though: places one step up or down are taken where that lowers the error of the pictures.
"""

from __future__ import annotations

from dataclasses import replace

import torch
from torch import Tensor

from ...model.lookup import SparseWeights
from ...model.stored_weights import encode_weights, is_coded, weight_table, weights_at
from ...runtime.memory import slices
from ...runtime.sparse import sparse_product
from .normal import NormalMatrix

# Rounds of moves, and the share of all weights that may move in one: moves of neighbours would
# overshoot together.
ROUNDS, SHARE = 16, 0.25
# Entries whose moves are weighed at once on a CPU: they stay in its caches.
BLOCK = 1 << 14


def rounded_together(
    entries: SparseWeights,
    kind: torch.dtype,
    normal: NormalMatrix,
    products: Tensor,
    generator: torch.Generator,
) -> SparseWeights:
    """The entries with weights as a file of number format `kind` holds them.

    Args:
        entries: of all texels, those of each sorted by lobe.
        kind: uint8, int16 or float32.
        normal: normal matrix of the weights.
        products: of the pictures with the lobes, `[N, C]`.
        generator: chooses which weights may move.
    """
    if not is_coded(kind) or not len(entries.index):
        return entries
    code, limits = encode_weights(entries.weight, kind)
    place = code.long()
    table = weight_table(limits, torch.iinfo(kind).max)
    blocks = list(slices(len(place), len(place) if place.is_cuda else BLOCK))
    weight = weights_at(place, table)
    value, gradient = _value(weight, normal, products)
    drawn = [torch.rand(place.shape, generator=generator) < SHARE for _ in range(ROUNDS)]
    for chance in torch.stack(drawn).to(place.device):
        given = (place, weight, gradient, normal.diagonal, chance)
        parts = [_moved(*(x[rows] for x in given), table) for rows in blocks]
        moved, found = (torch.cat(part) for part in zip(*parts, strict=True))
        lower, steeper = _value(found, normal, products)
        better = lower < value  # not read: the host would wait
        place, weight = torch.where(better, moved, place), torch.where(better, found, weight)
        value, gradient = torch.minimum(lower, value), torch.where(better, steeper, gradient)
    return replace(entries, weight=weight.to(entries.weight))


def _moved(
    place: Tensor,
    weight: Tensor,
    gradient: Tensor,
    diagonal: Tensor,
    chance: Tensor,
    table: Tensor,
) -> tuple[Tensor, Tensor]:
    """(places, weights) `[n, C]` after the moves that gain, each taken alone.

    Args:
        place, weight: before, `[n, C]`.
        gradient: of half of the squared error, `[n, C]`.
        diagonal: of the normal matrix, `[n]`.
        chance: which may move, `[n, C]`.
        table: weights of all places, `[last + 1, C]`.
    """
    last = len(table) - 1
    # The least and the largest place stay, as the scale follows from them.
    movable = (place > 2) & (place < last - 1) & chance
    moves = torch.stack((place - 1, place + 1)).clamp(0, last)
    reached = weights_at(moves, table)  # [2, n, C]
    change = reached - weight
    gain = change * (gradient + 0.5 * diagonal[:, None] * change)  # [2, n, C]
    best, way = gain.min(0)
    moving, way = movable & (best < 0.0), way[None]
    moved = torch.where(moving, moves.gather(0, way)[0], place)
    return moved, torch.where(moving, reached.gather(0, way)[0], weight)


def _value(weight: Tensor, normal: NormalMatrix, products: Tensor) -> tuple[Tensor, Tensor]:
    """Half of the squared error, less a constant, `[]` float64, and its gradient `[N, C]`."""
    gradient = sparse_product(normal.matrix, weight) - products.float()
    return 0.5 * (gradient.double() - products).mul_(weight).sum(), gradient
