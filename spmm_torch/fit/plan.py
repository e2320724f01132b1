"""Estimate of the time, memory and disk that a fit takes, made before it starts."""

from __future__ import annotations

import time
from dataclasses import dataclass

import torch

from ..config.fit import FitConfig
from ..data import BTF
from ..runtime.memory import Budget, held_memory
from ..runtime.progress import duration
from .cluster import OVERSAMPLING
from .stage_memory import working_bytes

# Fraction of the lobes found that the dictionary keeps, about.
KEPT_LOBES = 0.5
# Seconds of one core of 2.5 GHz: to decode a pixel; to search, for each sample, direction pair and
# lobe; to select for a texel, products apart.
DECODE_SECONDS, SEARCH_SECONDS, SELECT_SECONDS = 3e-8, 9e-6, 2e-4
# Size of the matrix product that measures the speed of this machine, and its repeats.
PROBE, REPEATS = 768, 3


@dataclass(frozen=True)
class Plan:
    """An estimate, right within a factor of about two.

    Attributes:
        seconds: from input to model.
        working_bytes: memory of the process, decoded values and what the system may drop apart.
        decoded_bytes: size of the decoded values; 0 if they are streamed.
    """

    seconds: float
    working_bytes: int
    decoded_bytes: int

    def kept_bytes(self, budget: Budget, cached: bool = False) -> int:
        """Decoded bytes in memory: all if the budget has room and they are not `cached` on disk."""
        return 0 if cached or self.decoded_bytes > budget.spare else self.decoded_bytes

    def describe(self, budget: Budget, cached: bool = False) -> str:
        """One line for the log."""
        kept = self.kept_bytes(budget, cached)
        memory, disk = self.working_bytes + kept, self.decoded_bytes - kept
        return (
            f"estimate: {duration(self.seconds)}, {memory / 1e9:.1f} GB of memory (allowed: "
            f"{budget.total / 1e9:.1f} GB), {disk / 1e9:.1f} GB of disk for decoded values"
        )


def estimate(btf: BTF, config: FitConfig, device: torch.device) -> Plan:
    """The estimate of a fit with these settings."""
    samples = min(config.cluster.count * config.sample.per_cluster, btf.texel_count)
    found = samples * config.search.max_lobes
    return Plan(
        seconds=_seconds(btf, config, device, samples),
        working_bytes=held_memory() + working_bytes(btf, config, device, samples, found),
        decoded_bytes=0 if btf.streamed else btf.raw_bytes * btf.pair_count // btf.measured_count,
    )


def _seconds(btf: BTF, config: FitConfig, device: torch.device, samples: int) -> float:
    """Seconds of all stages, given the number of samples."""
    values = btf.texel_count * btf.pair_count * btf.channels
    found = samples * config.search.max_lobes
    speed = _speed(device)
    rank = config.cluster.components + OVERSAMPLING
    products = (6 * rank + 2 * KEPT_LOBES * found) * values / speed
    cores = torch.get_num_threads() if device.type == "cpu" else 1
    decode = 0.0 if btf.streamed else DECODE_SECONDS * values / btf.channels / cores
    search = SEARCH_SECONDS * samples * btf.pair_count * config.search.max_lobes / cores
    select = SELECT_SECONDS * btf.texel_count / cores
    return decode + search + select + products


def _speed(device: torch.device) -> float:
    """Operations a second of a matrix product on `device`."""
    left = torch.ones(PROBE, PROBE, device=device)
    best = float("inf")
    for _ in range(REPEATS + 1):  # the first is a warm-up
        start = time.perf_counter()
        float((left @ left)[0, 0])
        best = min(best, time.perf_counter() - start)
    return 2.0 * PROBE**3 / best
