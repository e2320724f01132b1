"""Ragged lists in flat tensors: stable sorts of small keys, groups of equal keys, runs, ranges."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import torch
from torch import Tensor

# Where the lists of each value lie: (value, its consecutive positions), ascending.
Spans = list[tuple[int, slice]]
# Positions `[N]` in the order of their values, and where each value lies among them.
Grouped = tuple[Tensor, Spans]
# NumPy sorts 16-bit numbers by counting: ten times faster on one core than torch on two.
COUNTED = 1 << 16


def stable_order(key: Tensor, count: int) -> Tensor:
    """Positions `[N]` that sort `key [N]`; equal keys keep their order.

    Args:
        key: whole numbers from 0 to count - 1.
        count: how many values there are.
    """
    if key.is_cuda or count > COUNTED:
        return torch.argsort(key, stable=True)
    return torch.from_numpy(np.argsort(key.numpy().astype(np.uint16), kind="stable"))


def groups(key: Tensor, count: int) -> Iterator[tuple[int, Tensor]]:
    """(value, its ascending positions `[n]`) of every value in `key [N]`, ascending.

    The host waits for the device once.

    Args:
        key: whole numbers from 0 to count - 1.
        count: how many values there are.
    """
    sizes = torch.bincount(key, minlength=count).tolist()
    positions = stable_order(key, count).split(sizes)
    return ((value, rows) for value, rows in enumerate(positions) if len(rows))


def in_spans(key: Tensor, count: int) -> Grouped:
    """Positions `[N]` that sort `key [N]`, and where each value lies among them.

    Args:
        key: whole numbers from 0 to count - 1.
        count: how many values there are.
    """
    values = torch.arange(count, device=key.device)
    ends = (key[:, None] == values).sum(0).cumsum(0).tolist()  # bincount would wait once more
    starts = [0, *ends[:-1]]
    spans = [(value, slice(*span)) for value, span in enumerate(zip(starts, ends, strict=True))]
    return stable_order(key, count), [(value, own) for value, own in spans if own.start < own.stop]


def spans_within(spans: Spans, part: slice) -> Spans:
    """Where each value lies in some of the positions, counted from the first of these."""
    cut = [
        (value, slice(max(own.start, part.start), min(own.stop, part.stop))) for value, own in spans
    ]
    return [
        (value, slice(own.start - part.start, own.stop - part.start))
        for value, own in cut
        if own.start < own.stop
    ]


def run_starts(*keys: Tensor) -> Tensor:
    """True `[N]` where a run of equal entries begins; an entry is the tuple of all `keys [N]`."""
    new = torch.ones_like(keys[0], dtype=torch.bool)
    new[1:] = keys[0][1:] != keys[0][:-1]
    for key in keys[1:]:
        new[1:] |= key[1:] != key[:-1]
    return new


def ranges(start: Tensor, count: Tensor) -> tuple[Tensor, Tensor]:
    """All numbers from start[i] to start[i] + count[i] - 1, in order: (i `[N]`, number `[N]`).

    Args:
        start, count: of the ranges, `[R]` whole numbers, whose type the results have.
    """
    owner = torch.repeat_interleave(count)
    shift = start - (count.cumsum(0, dtype=count.dtype) - count)
    number = torch.arange(len(owner), dtype=owner.dtype, device=owner.device)
    return owner, number + shift.index_select(0, owner)
