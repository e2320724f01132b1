"""The allocator of the process: freed memory is kept for the next block of values.

The GNU C library gives every block over 32 MB back to the system when it is freed. The next one
then comes as pages that the system fills with zeros first, which takes as long as the work on them.
"""

from __future__ import annotations

import ctypes
import sys

# Parameters of mallopt in <malloc.h>.
TRIM_THRESHOLD, MMAP_THRESHOLD, ARENA_MAX = -1, -3, -8
# Bytes of a block that is given back at once: greater than the pictures of a view, less than all.
LARGEST_KEPT = 1 << 28
# Bytes that are kept at the end of the heap.
MOST_KEPT = 1 << 30


def keep_freed_memory() -> None:
    """Lets the process keep what it frees; does nothing where the C library is another one."""
    if sys.platform != "linux":
        return
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None)
    if mallopt is not None:
        mallopt(MMAP_THRESHOLD, LARGEST_KEPT)
        mallopt(TRIM_THRESHOLD, MOST_KEPT)
        mallopt(ARENA_MAX, 1)  # heaps of other threads hold no large blocks
