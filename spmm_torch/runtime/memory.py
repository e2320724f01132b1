"""How much memory there is, and how a fit shares it out."""

from __future__ import annotations

import math
import mmap
import os
import re
import resource
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import torch
from torch import Tensor

from ..errors import ConfigError, OutputError

UNITS = "KMGT"
SIZE = re.compile(rf"\s*(\d+(?:\.\d+)?)\s*(?:([{UNITS}])(I?))?B?\s*", re.IGNORECASE)
# Of what is free, unless a limit is given.
DEFAULT_SHARE = 0.5
MEMINFO, STATUS = Path("/proc/meminfo"), Path("/proc/self/status")
# Where a container's limit, its use, and what of that is files that the system drops if need be
# stand: the second and the first version of control groups.
CGROUPS = (
    (Path("/sys/fs/cgroup"), "memory.max", "memory.current", "inactive_file"),
    (
        Path("/sys/fs/cgroup/memory"),
        "memory.limit_in_bytes",
        "memory.usage_in_bytes",
        "total_inactive_file",
    ),
)
CGROUP_DETAILS = "memory.stat"


def parse_size(text: str) -> int:
    """Bytes of `4GB`, `500 MB` or `3GiB`.

    Raises:
        ConfigError: no size.
    """
    match = SIZE.fullmatch(text)
    if match is None:
        raise ConfigError(f"{text!r} is no size; expected a number with a unit such as 4GB.")
    number, unit, binary = match.groups()
    power = UNITS.index(unit.upper()) + 1 if unit else 0
    return int(float(number) * (1024 if binary else 1000) ** power)


def free_memory() -> int:
    """Bytes that this process may still take, as far as the system tells."""
    free = [_available()]
    for folder, limit, used, dropped in CGROUPS:
        try:
            left = int((folder / limit).read_text()) - int((folder / used).read_text())
            free.append(left + _droppable(folder, dropped))
        except (OSError, ValueError):  # no such file, or "max"
            continue
    return max(min(free), 0)


def _available() -> int:
    try:
        return _entry(MEMINFO, "MemAvailable:") * 1024
    except (OSError, ValueError):
        return os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")


def _droppable(cgroup: Path, key: str) -> int:
    try:
        return _entry(cgroup / CGROUP_DETAILS, key)
    except (OSError, ValueError):
        return 0


def _entry(path: Path, key: str) -> int:
    """The number after a word of a system file."""
    for line in path.read_text().splitlines():
        word, _, number = line.partition(" ")
        if word == key:
            return int(number.split()[0])
    raise ValueError(f"{path} lacks {key}")


def resident_memory() -> int:
    """Bytes of memory that this process holds now; 0 where the system does not tell."""
    try:
        pages = int(Path("/proc/self/statm").read_text().split()[1])
    except (OSError, ValueError, IndexError):
        return 0
    return pages * os.sysconf("SC_PAGE_SIZE")


def peak_resident_memory() -> int:
    """The most bytes of memory that this process has held.

    Not by getrusage where the system tells better: that counts the process that started this one,
    as it was when it forked.
    """
    try:
        for line in STATUS.read_text().splitlines():
            if line.startswith("VmHWM:"):
                return int(line.split()[1]) * 1024
    except OSError:
        pass
    unit = 1 if sys.platform == "darwin" else 1024  # Linux counts in KiB
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit


@dataclass(frozen=True)
class Budget:
    """Memory that a run may take.

    Attributes:
        total: bytes at most, with those that the process holds already.
        limited: whether a person has set the total.
        working: bytes that the stages need for their blocks and batches, the process included.
        kept: bytes of decoded values that stay in memory.
    """

    total: int
    limited: bool = False
    working: int = 0
    kept: int = 0

    @classmethod
    def build(cls, limit: int | None = None, processes: int = 1) -> Budget:
        """The budget of a limit, or of half of what is free, divided among `processes`."""
        if limit is not None:
            return cls(limit, limited=True)
        return cls(int(DEFAULT_SHARE * free_memory() / processes))

    def needing(self, working: int) -> Budget:
        """The same for stages that need `working` bytes.

        Raises:
            ConfigError: the limit is too low for any fit.
        """
        if self.limited and self.total < working:
            raise ConfigError(
                f"--max-memory is {self.total / 1e9:.2f} GB, but this input needs "
                f"{working / 1e9:.2f} GB even out of core; allow more, or lower "
                f"sample.per_cluster, cluster.count or search.bank_normals."
            )
        return Budget(max(self.total, working), self.limited, working)

    @property
    def spare(self) -> int:
        """Bytes left for data that may also lie on disk."""
        return self.total - self.working - self.kept


def slices(count: int, size: int) -> Iterator[slice]:
    """Consecutive slices of `size` that cover `count`."""
    for start in range(0, count, size):
        yield slice(start, min(start + size, count))


def scratch(shape: tuple[int, ...], in_memory: bool, device: torch.device) -> Tensor:
    """An uninitialized float32 tensor on a device, or on the CPU in a file that ends with it.

    Raises:
        OutputError: the disk is full.
    """
    if in_memory or 0 in shape:
        return torch.empty(shape, device=device)
    size = 4 * math.prod(shape)
    try:
        with tempfile.TemporaryFile(prefix="spmm_torch-") as file:
            # A hole that the disk cannot fill would kill the process at the first write.
            os.posix_fallocate(file.fileno(), 0, size)
            mapped = mmap.mmap(file.fileno(), size)
    except OSError as error:
        raise OutputError(
            f"{size / 1e9:.1f} GB of scratch space cannot be had in {tempfile.gettempdir()} "
            f"({error}); free some, set TMPDIR to a larger disk, or allow more with --max-memory."
        ) from error
    return torch.frombuffer(mapped, dtype=torch.float32).view(shape)
