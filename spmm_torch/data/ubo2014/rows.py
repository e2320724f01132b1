"""Rows of the factors in a `.btf` file."""

from __future__ import annotations

from io import FileIO

import numpy as np
import torch
from torch import Tensor

from ...errors import DataError
from ..file_rows import RowLayout
from ..file_rows import read_rows as read_file_rows
from .header import Matrix


def read_rows(stream: FileIO, matrix: Matrix, rows: np.ndarray) -> np.ndarray:
    """Rows `[n, k]` of a matrix as stored, by indices `[n]` in any order, also repeated.

    Raises:
        DataError: the file ends before the last of them.
    """
    try:
        layout = RowLayout(matrix.offset, matrix.dtype, matrix.width)
        return read_file_rows(stream, layout, rows)
    except EOFError as error:
        raise DataError(
            f"{stream.name} ends within its factors, though it was complete when opened; "
            f"expected it to stay as it is while in use; restore it and start again."
        ) from error


def finite_rows(stream: FileIO, matrix: Matrix, rows: np.ndarray) -> Tensor:
    """Rows `[n, k]` of a matrix as float32, all finite; see `read_rows`.

    Raises:
        DataError: the file ends before the last of them, or a number is not finite.
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
