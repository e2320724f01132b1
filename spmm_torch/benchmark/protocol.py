"""The protocol of timing: warm-up, repeats, median and spread, and a synchronized device."""

from __future__ import annotations

import gc
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from typing import Any, TypeVar

import torch

from ..runtime.memory import peak_resident_memory

# Writing this code to this file resets Linux's peak of the memory of a process.
PEAK_RESET, RESET_CODE = Path("/proc/self/clear_refs"), "5"

R = TypeVar("R")


@dataclass(frozen=True)
class Protocol:
    """The number of repeats.

    Attributes:
        repeats: of each measurement, at most.
        patience: seconds after which a measurement is not repeated; its number of runs is
            published.
    """

    repeats: int
    patience: float


@dataclass(frozen=True)
class Timing:
    """Seconds of the runs of one measurement."""

    runs: tuple[float, ...]

    @property
    def median(self) -> float:
        """The published seconds."""
        return median(self.runs)

    def to_dict(self) -> dict[str, Any]:
        """Median, spread and number of the runs."""
        return {
            "median": self.median,
            "fastest": min(self.runs),
            "slowest": max(self.runs),
            "runs": len(self.runs),
        }


def measure(
    work: Callable[[], R], protocol: Protocol, device: torch.device, *, warm_up: bool = True
) -> tuple[R, Timing]:
    """The last result of some work, and its time.

    Args:
        work: that is timed; the same at every call.
        protocol: of the repeats.
        device: that is synchronized before and after.
        warm_up: run the work once before; not needed if similar work has run already.
    """
    if warm_up:
        work()
    result, seconds = _timed(work, device)
    runs = [seconds]
    while len(runs) < protocol.repeats and sum(runs) < protocol.patience:
        result, seconds = _timed(work, device)
        runs.append(seconds)
    return result, Timing(tuple(runs))


def _timed(work: Callable[[], R], device: torch.device) -> tuple[R, float]:
    """The result of some work, and its seconds."""
    start = now(device)
    result = work()
    return result, now(device) - start


def now(device: torch.device) -> float:
    """The clock in seconds, after all queued work of a GPU."""
    if device.type == "cuda":
        torch.cuda.synchronize(device)
    return time.perf_counter()


def stage_medians(reports: Sequence[dict[str, Any]]) -> dict[str, float]:
    """The median seconds of each stage of a fit over its runs."""
    stages = reports[0]["seconds"]
    return {stage: median(report["seconds"][stage] for report in reports) for stage in stages}


def forget_peak(device: torch.device) -> bool:
    """Resets the peak of the memory; False where the system does not allow that."""
    gc.collect()
    if device.type == "cuda":
        torch.cuda.reset_peak_memory_stats(device)
        return True
    before = peak_resident_memory()
    with suppress(OSError):
        PEAK_RESET.write_text(RESET_CODE)
        return peak_resident_memory() <= before
    return False
