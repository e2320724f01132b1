"""Weights rounded to what a file holds, so that their errors cancel as far as they can.

Each weight alone would go to its nearest place on the scale. Lobes of near texels show in the same
pixels, though: places one step up or down are taken where that lowers the error of the pictures.
"""

from __future__ import annotations

from dataclasses import replace

import torch
from torch import Tensor

from ...model.lookup import SparseWeights
from ...model.stored_weights import decode_weights, encode_weights, is_coded
from .normal import NormalMatrix

# Rounds of moves, and the share of all weights that may move in one: moves of neighbours would
# overshoot together.
ROUNDS, SHARE = 16, 0.25


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
    last = torch.iinfo(kind).max
    place = code.long()
    weight = decode_weights(place, limits, last)
    value, gradient = _value(weight, normal, products)
    for _ in range(ROUNDS):
        # The least and the largest place stay, as the scale follows from them.
        movable = (place > 2) & (place < last - 1)
        movable &= (torch.rand(place.shape, generator=generator) < SHARE).to(place.device)
        moves = torch.stack((place - 1, place + 1)).clamp(0, last)
        change = torch.stack([decode_weights(each, limits, last) for each in moves]) - weight
        gain = change * (gradient + 0.5 * normal.diagonal[:, None] * change)  # [2, N, C]
        best, way = gain.min(0)
        moved = torch.where(movable & (best < 0.0), moves.gather(0, way[None])[0], place)
        found = decode_weights(moved, limits, last)
        lower, steeper = _value(found, normal, products)
        if lower < value:
            place, weight, value, gradient = moved, found, lower, steeper
    return replace(entries, weight=weight.to(entries.weight))


def _value(weight: Tensor, normal: NormalMatrix, products: Tensor) -> tuple[float, Tensor]:
    """Half of the squared error, less a constant, and its gradient `[N, C]`."""
    gradient = normal.matrix @ weight - products.float()
    return 0.5 * float((weight.double() * (gradient.double() - products)).sum()), gradient
