"""How everything is timed: warm-up, repeats, median and spread, the device waited for."""

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

# Writing this resets the peak that Linux keeps of a process's memory.
PEAK_RESET, RESET_CODE = Path("/proc/self/clear_refs"), "5"

R = TypeVar("R")


@dataclass(frozen=True)
class Protocol:
    """How often things are measured.

    Attributes:
        repeats: of each measurement, at most.
        patience: seconds after which a measurement is not repeated any more; the number of its
            runs is published with it.
    """

    repeats: int
    patience: float


@dataclass(frozen=True)
class Timing:
    """Seconds of the runs of one measurement."""

    runs: tuple[float, ...]

    @property
    def median(self) -> float:
        """The seconds that are published."""
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
    """The last result of some work, and its seconds.

    Args:
        work: what is timed; the same at every call.
        protocol: how often.
        device: what is waited for before and after.
        warm_up: run it once before, unless something like it has run already.
    """
    if warm_up:
        work()
    runs: list[float] = []
    while not runs or (len(runs) < protocol.repeats and sum(runs) < protocol.patience):
        start = now(device)
        result = work()
        runs.append(now(device) - start)
    return result, Timing(tuple(runs))


def now(device: torch.device) -> float:
    """Seconds, once a GPU has done what is queued."""
    if device.type == "cuda":
        torch.cuda.synchronize(device)
    return time.perf_counter()


def stage_medians(reports: Sequence[dict[str, Any]]) -> dict[str, float]:
    """The median over runs of the seconds of each stage of a fit."""
    stages = reports[0]["seconds"]
    return {stage: median(report["seconds"][stage] for report in reports) for stage in stages}


def forget_peak(device: torch.device) -> bool:
    """Starts the peak of the memory anew; False where the system does not allow that."""
    gc.collect()
    if device.type == "cuda":
        torch.cuda.reset_peak_memory_stats(device)
        return True
    before = peak_resident_memory()
    with suppress(OSError):
        PEAK_RESET.write_text(RESET_CODE)
        return peak_resident_memory() <= before
    return False
