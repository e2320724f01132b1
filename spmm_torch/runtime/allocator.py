"""The allocator of the process: freed memory is kept for the next block of values.

The GNU C library gives every block over 32 MB back to the system when it is freed. The next one
then comes as pages that the system fills with zeros first, which takes as long as the work on them.
"""

from __future__ import annotations

import ctypes
import sys
from collections.abc import Callable

# Parameters of mallopt in <malloc.h>.
TRIM_THRESHOLD, MMAP_THRESHOLD, ARENA_MAX = -1, -3, -8
# Bytes of a block that is given back at once: greater than the pictures of a view, less than all.
LARGEST_KEPT = 1 << 27
# Bytes that are kept at the end of the heap.
MOST_KEPT = 1 << 30


def keep_freed_memory() -> None:
    """Lets the process keep what it frees; does nothing where the C library is another one."""
    mallopt = _of_library("mallopt")
    if mallopt is not None:
        mallopt(MMAP_THRESHOLD, LARGEST_KEPT)
        mallopt(TRIM_THRESHOLD, MOST_KEPT)
        mallopt(ARENA_MAX, 1)  # heaps of other threads hold no large blocks


def give_back_freed_memory() -> None:
    """Gives what was kept back to the system: between stages whose blocks differ in size."""
    trim = _of_library("malloc_trim")
    if trim is not None:
        trim(0)


def _of_library(name: str) -> Callable[..., int] | None:
    """A function of the GNU C library; None where the C library is another one."""
    return getattr(ctypes.CDLL(None), name, None) if sys.platform == "linux" else None
