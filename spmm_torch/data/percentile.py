"""An exact percentile of more values than fit into memory."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable

import torch
from torch import Tensor

HALF_BITS = 16
HALF_COUNT = 1 << HALF_BITS
SIGN_FREE_MASK = 0x7FFFFFFF


def percentile(chunks: Callable[[], Iterable[Tensor]], fraction: float) -> float:
    """Smallest value that at least `fraction` of all values do not exceed (nearest rank).

    The bits of non-negative floats sort as integers, so a histogram of the upper 16 bits finds
    the bin and a second one, of the lower 16 bits inside it, the value: two passes, no sort.

    Args:
        chunks: gives the values anew at each call, float32; negative ones count as zero.
        fraction: in (0, 1].
    """
    upper = torch.zeros(HALF_COUNT, dtype=torch.int64)
    for chunk in chunks():
        upper += torch.bincount(_bits(chunk) >> HALF_BITS, minlength=HALF_COUNT)
    rank = max(math.ceil(fraction * int(upper.sum())), 1)
    high = _bin_of_rank(upper, rank)
    rank -= int(upper[:high].sum())

    lower = torch.zeros(HALF_COUNT, dtype=torch.int64)
    for chunk in chunks():
        bits = _bits(chunk)
        bits = bits[(bits >> HALF_BITS) == high]
        lower += torch.bincount(bits & (HALF_COUNT - 1), minlength=HALF_COUNT)
    code = (high << HALF_BITS) | _bin_of_rank(lower, rank)
    return float(torch.tensor([code], dtype=torch.int32).view(torch.float32))


def _bits(values: Tensor) -> Tensor:
    """The bit patterns of non-negative float32 values, flat; the mask removes minus zero."""
    return values.clamp_min(0.0).contiguous().view(torch.int32).flatten() & SIGN_FREE_MASK


def _bin_of_rank(histogram: Tensor, rank: int) -> int:
    """The bin that holds the value of the given rank, counted from 1."""
    return int(torch.searchsorted(histogram.cumsum(0), torch.tensor(rank)))
