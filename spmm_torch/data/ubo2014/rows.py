"""Rows of a matrix that lies in a file, read by position.

A mapped file would be simpler, but every page once touched counts as memory of the process for
as long as it stays mapped: the whole file after one pass. Reading costs 2 microseconds a row
where rows lie apart.
"""

from __future__ import annotations

from typing import BinaryIO

import numpy as np
import torch
from torch import Tensor

from ...errors import DataError
from .header import Matrix


def read_rows(stream: BinaryIO, matrix: Matrix, rows: np.ndarray) -> np.ndarray:
    """Some rows `[n, k]` of a matrix, in any order and repeated at will, as they are stored.

    Neighbours are read in one piece. A stream belongs to one thread at a time.

    Raises:
        DataError: the file ends before them.
    """
    wanted, inverse = np.unique(rows, return_inverse=True)
    found = np.empty((len(wanted), matrix.width), dtype=matrix.dtype)
    buffer = memoryview(found).cast("B")
    size = matrix.row_bytes
    starts = np.flatnonzero(np.diff(wanted, prepend=-2) != 1)
    for start, stop in zip(starts, np.append(starts[1:], len(wanted)), strict=True):
        run = buffer[int(start) * size : int(stop) * size]
        stream.seek(matrix.offset + int(wanted[start]) * size)
        if stream.readinto(run) != len(run):
            raise DataError(
                f"{stream.name} ends within its factors, though it was complete when opened; "
                f"expected it to stay as it is while in use; restore it and start again."
            )
    return found[inverse]


def finite_rows(stream: BinaryIO, matrix: Matrix, rows: np.ndarray) -> Tensor:
    """Rows as `read_rows` gives them, `[n, k]` float32.

    Raises:
        DataError: the file ends before them, or one holds a number that is not finite.
    """
    values = torch.from_numpy(read_rows(stream, matrix, rows)).float()
    low, high = values.aminmax()  # both are NaN if any value is
    if low > -torch.inf and high < torch.inf:
        return values
    row, component = (int(index) for index in (~values.isfinite()).nonzero()[0])
    offset = matrix.offset + int(rows[row]) * matrix.row_bytes + component * matrix.dtype.itemsize
    raise DataError(
        f"{stream.name} holds the factor {float(values[row, component])} at byte {offset}; "
        f"expected finite numbers within float32; the file is damaged: copy it again from where "
        f"it came."
    )
