"""Rows of an array that lies in a file, read by position.

A mapped file would be simpler, but pages that were touched, and their neighbours, count as memory
of the process for as long as they stay mapped. Reading costs a few microseconds a row where rows
lie apart.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import BinaryIO

import numpy as np


@dataclass(frozen=True)
class RowLayout:
    """Where the rows of an array `[N, width]` lie in a file."""

    offset: int
    dtype: np.dtype
    width: int

    @property
    def row_bytes(self) -> int:
        """Size of one row."""
        return self.width * self.dtype.itemsize


def read_rows(stream: BinaryIO, layout: RowLayout, rows: np.ndarray) -> np.ndarray:
    """Some rows `[n, width]`, in any order and repeated at will; neighbours in one piece.

    A stream belongs to one thread at a time.

    Raises:
        EOFError: the file ends before them.
    """
    wanted, inverse = np.unique(rows, return_inverse=True)
    found = np.empty((len(wanted), layout.width), dtype=layout.dtype)
    if not found.size:
        return found[inverse]
    buffer, size = memoryview(found).cast("B"), layout.row_bytes
    starts = np.flatnonzero(np.diff(wanted, prepend=-2) != 1)
    for start, stop in zip(starts, np.append(starts[1:], len(wanted)), strict=True):
        run = buffer[int(start) * size : int(stop) * size]
        _fill(stream, layout.offset + int(wanted[start]) * size, run)
    in_order = len(wanted) == len(rows) and bool((inverse[1:] > inverse[:-1]).all())
    return found if in_order else found[inverse]


def read_columns(
    stream: BinaryIO, layout: RowLayout, row_count: int, start: int, stop: int
) -> np.ndarray:
    """Columns `start` to `stop` of all rows, `[row_count, stop - start]`.

    Raises:
        EOFError: the file ends before them.
    """
    found = np.empty((row_count, stop - start), dtype=layout.dtype)
    if not found.size:
        return found
    buffer, size = memoryview(found).cast("B"), (stop - start) * layout.dtype.itemsize
    first = layout.offset + start * layout.dtype.itemsize
    for row in range(row_count):
        _fill(stream, first + row * layout.row_bytes, buffer[row * size : (row + 1) * size])
    return found


def _fill(stream: BinaryIO, position: int, target: memoryview) -> None:
    stream.seek(position)
    done = 0
    while done < len(target):  # one read gives 2 GB at most
        count = stream.readinto(target[done:])
        if not count:
            raise EOFError("the file ends early")
        done += count
