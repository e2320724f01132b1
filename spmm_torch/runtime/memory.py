"""The memory of this machine, and the part of it that a fit may take."""

from __future__ import annotations

import errno
import math
import mmap
import os
import shutil
import sys
import tempfile
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import IO, TypeVar

import torch
from torch import Tensor

from ..errors import ConfigError, OutputError

try:
    import resource
except ImportError:  # Windows has none
    resource = None

T = TypeVar("T")

# Fraction of the free memory that a run may take, unless a limit is given.
DEFAULT_FRACTION = 0.5
# Bytes of memory where the system tells none: --max-memory says more.
ASSUMED_MEMORY = 8 << 30
MEMINFO, STATUS = Path("/proc/meminfo"), Path("/proc/self/status")
# Pages in STATUS that have no file to be read from again.
HELD = ("RssAnon:", "RssShmem:")
# Control groups limit the memory of a container. For their version 2 and 1: the folder, the file of
# the limit, the file of the use, and the key in CGROUP_DETAILS of reclaimable file pages.
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


def free_memory() -> int:
    """Bytes that this process may still take, by what the system and its container report."""
    free = [_available()]
    for folder, limit, used, reclaimable in CGROUPS:
        try:
            left = int((folder / limit).read_text()) - int((folder / used).read_text())
            free.append(left + _reclaimable(folder, reclaimable))
        except (OSError, ValueError):  # no such file, or no limit ("max")
            continue
    return max(min(free), 0)


def _available() -> int:
    """Bytes that the system has available; all of its memory where it does not report them.

    ASSUMED_MEMORY where it tells neither, as Windows does.
    """
    with suppress(OSError, ValueError):
        return _entry(MEMINFO, "MemAvailable:") * 1024
    if hasattr(os, "sysconf"):
        with suppress(OSError, ValueError):
            return os.sysconf("SC_PHYS_PAGES") * mmap.PAGESIZE
    return ASSUMED_MEMORY


def _reclaimable(cgroup: Path, key: str) -> int:
    """Bytes of file pages that the system frees on demand; 0 where it does not report them."""
    try:
        return _entry(cgroup / CGROUP_DETAILS, key)
    except (OSError, ValueError):
        return 0


def _entry(path: Path, key: str) -> int:
    """The number after a key in a file of the system."""
    for line in path.read_text().splitlines():
        words = line.split()
        if words[:1] == [key]:
            return int(words[1])
    raise ValueError(f"{path} lacks {key}")


def held_memory() -> int:
    """Bytes that this process holds now and the system cannot drop; 0 where none are reported.

    The code of libraries and values in mapped files do not count: they are read again on demand.
    """
    try:
        return 1024 * sum(_entry(STATUS, key) for key in HELD)
    except (OSError, ValueError):
        return 0


def peak_resident_memory() -> int:
    """The largest number of bytes of memory that this process has held; 0 where nothing tells.

    On Linux not by getrusage, which includes the memory of the parent process at the fork.
    """
    try:
        for line in STATUS.read_text().splitlines():
            if line.startswith("VmHWM:"):
                return int(line.split()[1]) * 1024
    except OSError:
        pass
    if resource is None:
        return 0
    unit = 1 if sys.platform == "darwin" else 1024  # Linux counts in KiB
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit


@dataclass(frozen=True)
class Budget:
    """Memory that a run may take.

    Attributes:
        total: limit in bytes, including what the process holds already.
        limited: whether the user has set the limit.
        working: bytes of the process and of the blocks and batches of its stages.
        kept: bytes of decoded values that stay in memory.
    """

    total: int
    limited: bool = False
    working: int = 0
    kept: int = 0

    @classmethod
    def build(cls, limit: int | None = None, processes: int = 1) -> Budget:
        """The budget of a limit in bytes; without one, half of the free memory over `processes`."""
        if limit is not None:
            return cls(limit, limited=True)
        return cls(int(DEFAULT_FRACTION * free_memory() / processes))

    def needing(self, working: int) -> Budget:
        """The budget of stages that need `working` bytes; without a limit, it grows to them.

        Raises:
            ConfigError: the limit is too low for any fit.
        """
        if self.limited and self.total < working:
            raise ConfigError(
                f"--max-memory is {self.total / 1e9:.2f} GB, but this input needs "
                f"{working / 1e9:.2f} GB even out of core; allow more, take less of the input "
                f"with --crop, or lower sample.per_cluster, cluster.count or search.bank_normals."
            )
        return Budget(max(self.total, working), self.limited, working)

    @property
    def spare(self) -> int:
        """Bytes left for data that could also be on disk."""
        return self.total - self.working - self.kept

    def left(self) -> int | None:
        """Bytes of the limit that the process does not hold now; None without a limit."""
        return max(0, self.total - held_memory()) if self.limited else None


def slices(count: int, size: int) -> Iterator[slice]:
    """Consecutive slices of length `size`, the last one shorter, that cover `count` items."""
    for start in range(0, count, size):
        yield slice(start, min(start + size, count))


def blocks_of(items: Iterable[T], size: Callable[[T], int], most: int) -> Iterator[list[T]]:
    """Items in their order, in blocks of at most `most` by `size`; a larger item is alone."""
    block: list[T] = []
    total = 0
    for item in items:
        own = size(item)
        if block and total + own > most:
            yield block
            block, total = [], 0
        block.append(item)
        total += own
    if block:
        yield block


# What systems say that cannot reserve space; macOS and Windows lack the function.
NO_RESERVING = (errno.ENOSYS, errno.EOPNOTSUPP, errno.EINVAL)


def reserve(file: IO[bytes], size: int) -> None:
    """Reserves `size` bytes on disk for an open file, which takes that size.

    Without reserved space, a full disk would kill the process at a write to mapped memory. Where
    the system cannot reserve, enough must be free.

    Raises:
        OSError: the disk is full.
    """
    if hasattr(os, "posix_fallocate"):
        try:
            os.posix_fallocate(file.fileno(), 0, size)
            return
        except OSError as error:
            if error.errno not in NO_RESERVING:
                raise
    place = file.name if isinstance(file.name, str) else tempfile.gettempdir()
    if shutil.disk_usage(Path(place).parent).free < size:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
    file.truncate(size)


def scratch(shape: tuple[int, ...], in_memory: bool, device: torch.device) -> Tensor:
    """An uninitialized float32 tensor `[...]` of a shape.

    Args:
        shape: shape of the tensor.
        in_memory: True: on `device`; False: on the CPU, in a temporary file that goes with it.
        device: device of a tensor in memory.

    Raises:
        OutputError: the disk is full.
    """
    if in_memory or 0 in shape:
        return torch.empty(shape, device=device)
    size = 4 * math.prod(shape)
    try:
        with tempfile.TemporaryFile(prefix="spmm_torch-") as file:
            reserve(file, size)
            mapped = mmap.mmap(file.fileno(), size)
    except OSError as error:
        raise OutputError(
            f"{size / 1e9:.1f} GB of scratch space cannot be had in {tempfile.gettempdir()} "
            f"({error}); free some, set TMPDIR to a larger disk, or allow more with --max-memory."
        ) from error
    return torch.frombuffer(mapped, dtype=torch.float32).view(shape)
