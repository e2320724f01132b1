"""Seconds, work and peak memory of a piece of work on the device."""

from __future__ import annotations

import time
from collections.abc import Callable

import torch

from spmm_torch.benchmark.counting import Work, WorkCounter
from spmm_torch.benchmark.protocol import now
from tests.benchmarks.on_gpu.rows import Put, Row

REPEATS = 5


def measured(
    name: str,
    work: Callable[[], object],
    device: torch.device,
    patience: float,
    put: Put,
    *,
    times: int = 1,
    note: str = "",
) -> None:
    """Puts a row: the fastest of some runs, after one whose operations are counted.

    Args:
        name: of the row.
        work: that is measured; it contains `times` of what the row tells of.
        device: of the work.
        patience: seconds after which it is not repeated.
        put: takes the row.
        times: by which seconds and work are divided.
        note: of the row.
    """
    counted = Work()
    with WorkCounter(counted):
        work()
    forget_peak(device)
    seconds, first = [], time.monotonic()
    while not seconds or (len(seconds) < REPEATS and time.monotonic() - first < patience):
        start = now(device)
        work()
        seconds.append(now(device) - start)
    flops, moved = counted.flops / times, counted.bytes / times
    put(Row(name, min(seconds) / times, flops, moved, peak_of(device), note))


def forget_peak(device: torch.device) -> None:
    """Begins a peak of device memory anew."""
    if device.type == "cuda":
        torch.cuda.reset_peak_memory_stats(device)


def peak_of(device: torch.device) -> int | None:
    """Bytes of device memory at most since `forget_peak`; None on a CPU."""
    return torch.cuda.max_memory_allocated(device) if device.type == "cuda" else None
