"""Rows of an array in a file, read by position.

A memory-mapped file would be simpler, but its touched pages count as memory of the process. Reading
costs a few microseconds for each row that is not next to another one.
"""

from __future__ import annotations

from dataclasses import dataclass
from io import FileIO

import numpy as np


@dataclass(frozen=True)
class RowLayout:
    """Offset, type and row length of an array `[N, width]` in a file."""

    offset: int
    dtype: np.dtype
    width: int

    @property
    def row_bytes(self) -> int:
        """Bytes of one row."""
        return self.width * self.dtype.itemsize


def read_rows(stream: FileIO, layout: RowLayout, rows: np.ndarray) -> np.ndarray:
    """Some rows `[n, width]` of an array, read in runs of neighbours.

    Args:
        stream: file that no other thread uses meanwhile.
        layout: place of the array in the file.
        rows: indices `[n]` of rows, in any order, also repeated.

    Raises:
        EOFError: the file ends before the last of them.
    """
    wanted, inverse = np.unique(rows, return_inverse=True)
    found = np.empty((len(wanted), layout.width), dtype=layout.dtype)
    if not found.size:
        return found[inverse]
    buffer, size = _bytes_of(found), layout.row_bytes
    starts = np.flatnonzero(np.diff(wanted, prepend=-2) != 1)
    for start, stop in zip(starts, np.append(starts[1:], len(wanted)), strict=True):
        run = buffer[int(start) * size : int(stop) * size]
        _fill(stream, layout.offset + int(wanted[start]) * size, run)
    in_order = len(wanted) == len(rows) and bool((inverse[1:] > inverse[:-1]).all())
    return found if in_order else found[inverse]


def read_columns(
    stream: FileIO, layout: RowLayout, row_count: int, start: int, stop: int
) -> np.ndarray:
    """Columns `start` to `stop` of all rows of an array, `[row_count, stop - start]`.

    Raises:
        EOFError: the file ends before the last of them.
    """
    found = np.empty((row_count, stop - start), dtype=layout.dtype)
    if not found.size:
        return found
    buffer, size = _bytes_of(found), (stop - start) * layout.dtype.itemsize
    first = layout.offset + start * layout.dtype.itemsize
    for row in range(row_count):
        _fill(stream, first + row * layout.row_bytes, buffer[row * size : (row + 1) * size])
    return found


def _bytes_of(array: np.ndarray) -> memoryview:
    """The memory of a contiguous array."""
    return memoryview(array.data).cast("B")


def _fill(stream: FileIO, position: int, target: memoryview) -> None:
    """Reads as many bytes from a position on as the target holds."""
    stream.seek(position)
    done = 0
    while done < len(target):  # one read gives at most 2 GB
        count = stream.readinto(target[done:])
        if not count:
            raise EOFError("the file ends early")
        done += count
