"""Weights as a model file holds them: one or two bytes each on a logarithmic scale.

The sum of lobes needs each weight to a share of its own size, which is what a logarithmic scale
gives: steps of 4.6 % at worst in one byte, of 0.06 % in two.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from ..runtime import tensor_file
from .lookup import SparseWeights

# Number formats of weights by their names, the smallest first; integers are places on a
# logarithmic scale.
WEIGHT_TYPES = {"byte": torch.uint8, "int16": torch.int16, "float32": torch.float32}
# Least weight that has a place of its own, as a share of the largest of its channel.
LEAST_SHARE = {torch.uint8: 1e-5, torch.int16: 1e-9}
# Lobes of a group: a lobe of a known group needs one byte.
GROUP = 256


@dataclass(frozen=True)
class StoredEntries:
    """The lobes of all texels, as a file lists them.

    Attributes:
        count: number of entries of each texel, `[T]`, or by group of GROUP lobes, `[T, G]`.
        index: lobe of each entry, `[N]`, or its place in its group.
    """

    count: Tensor
    index: Tensor


def encode_weights(weight: Tensor, dtype: torch.dtype) -> tuple[Tensor, Tensor]:
    """Weights as places on a logarithmic scale, 0 for 0; see `decode_weights`.

    Encoding what was decoded gives the same codes and the same range.

    Args:
        weight: `[N, C]`; those below half of the least that has a place become 0.
        dtype: uint8 or int16.

    Returns:
        (code `[N, C]` of type `dtype`, least and largest weight of each channel `[C, 2]`).
    """
    least, largest = _range(weight, LEAST_SHARE[dtype])
    steps = torch.iinfo(dtype).max - 1
    span = (largest / least).log()
    share = (weight.double().clamp(min=least) / least).log() / torch.where(span > 0.0, span, 1.0)
    place = 1.0 + torch.round(steps * share).clamp(0, steps)
    code = torch.where(weight >= 0.5 * least, place, 0.0)
    return code.to(dtype), torch.stack((least, largest), dim=1).float()


def are_within(weight: Tensor, dtype: torch.dtype) -> bool:
    """Whether every weight of `[N, C]` but 0 is large enough for a place of its own."""
    largest = weight.amax(0) if len(weight) else weight.sum(0)
    return bool(((weight <= 0.0) | (weight >= LEAST_SHARE[dtype] * largest)).all())


def decode_weights(code: Tensor, limits: Tensor, last: int | None = None) -> Tensor:
    """Weights `[N, C]` float32 of codes `[N, C]` and ranges `[C, 2]`.

    Code 0 is 0; code n is least * (largest / least)^((n - 1) / (last - 1)), where `last` is the
    largest code of the type.

    Args:
        code: `[N, C]`.
        limits: least and largest weight of each channel, `[C, 2]`.
        last: largest code; None: that of the type of `code`.
    """
    last = torch.iinfo(code.dtype).max if last is None else last
    return weights_at(code.long(), weight_table(limits, last))


def weight_table(limits: Tensor, last: int) -> Tensor:
    """Weights of the codes from 0 to `last`, `[last + 1, C]`, of ranges `[C, 2]`.

    The table is made on the CPU, so that all devices agree.
    """
    return _scale(limits.cpu(), last).to(limits.device)


def weights_at(place: Tensor, table: Tensor) -> Tensor:
    """The weights `[..., C]` at the places `[..., C]` long of a `table [last + 1, C]`."""
    return table[place, torch.arange(place.shape[-1], device=place.device)]


def rounded(weights: SparseWeights, dtype: torch.dtype) -> SparseWeights:
    """The weights as they come back from a file: of these values, each texel's sorted by lobe.

    Args:
        weights: of a model.
        dtype: number format of the file; nothing changes for float32.
    """
    if not is_coded(dtype):
        return weights
    ordered = by_lobe(weights)
    weight = decode_weights(*encode_weights(ordered.weight, dtype)).to(weights.weight)
    return SparseWeights(ordered.offset, ordered.index, weight)


def is_coded(dtype: torch.dtype) -> bool:
    """Whether weights of this format are stored as places on a logarithmic scale."""
    return dtype != torch.float32


def by_lobe(weights: SparseWeights) -> SparseWeights:
    """The same entries, those of each texel in the order of their lobes."""
    count = weights.offset[1:] - weights.offset[:-1]
    texel = torch.repeat_interleave(count)
    order = torch.argsort(weights.index, stable=True)
    order = order[torch.argsort(texel[order], stable=True)]
    return SparseWeights(weights.offset, weights.index[order], weights.weight[order])


def encode_entries(weights: SparseWeights, lobes: int) -> StoredEntries:
    """Counts and lobes of entries that are sorted by lobe, in the fewest bytes.

    Args:
        weights: of a model, as by `by_lobe`.
        lobes: number of lobes, J.
    """
    count = weights.offset[1:] - weights.offset[:-1]
    groups = -(-lobes // GROUP)
    if (groups - 1) * len(count) >= len(weights.index):
        return StoredEntries(tensor_file.narrow(count), tensor_file.narrow(weights.index))
    group = torch.div(weights.index, GROUP, rounding_mode="floor")
    place = torch.repeat_interleave(count) * groups + group
    by_group = torch.bincount(place, minlength=len(count) * groups).view(-1, groups)
    return StoredEntries(
        tensor_file.narrow(by_group), tensor_file.narrow(weights.index - group * GROUP)
    )


def decode_entries(entries: StoredEntries) -> tuple[Tensor, Tensor]:
    """(offset `[T + 1]`, lobe of each entry `[N]`), both long.

    Raises:
        ValueError: there are not as many entries as the texels count.
    """
    if (counted := int(entries.count.sum())) != len(entries.index):
        raise ValueError(f"{len(entries.index)} entries of {counted}")
    count = entries.count.long().view(len(entries.count), -1)  # [T, G]
    group = torch.arange(count.shape[1], device=count.device).repeat(len(count))
    first = GROUP * torch.repeat_interleave(group, count.flatten())
    ends = count.sum(1).cumsum(0)
    return torch.cat((ends.new_zeros(1), ends)), entries.index.long() + first


def _range(weight: Tensor, share: float) -> tuple[Tensor, Tensor]:
    """Least and largest weight `[C]` float64 that get a place of their own; 1 where all are 0."""
    if not len(weight):
        one = torch.ones(weight.shape[1], dtype=torch.float64, device=weight.device)
        return one, one
    weight = weight.detach().double()
    largest = weight.amax(0)
    least = torch.where(weight >= share * largest, weight, torch.inf).amin(0)
    empty = largest <= 0.0
    return least.masked_fill(empty, 1.0), largest.masked_fill(empty, 1.0)


def _scale(limits: Tensor, last: int) -> Tensor:
    """The weight of each code from 0 to `last`, `[last + 1, C]` float32, of ranges `[C, 2]`."""
    least, largest = limits.double().unbind(1)
    share = torch.arange(last, dtype=torch.float64)[:, None] / (last - 1)
    places = least * (largest / least) ** share
    return torch.cat((places.new_zeros(1, len(limits)), places)).float()
