"""Writer of UBO2014 files from given factors."""

from __future__ import annotations

import struct
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

import numpy as np
from torch import Tensor

from ...errors import ConfigError, DataError, alternatives
from ...runtime.atomic import new_file
from .colour import LOG_Y_RATIOS, RGB
from .header import DFMF, FMF12, SCALARS, VARIANTS, Header
from .order import BOTTOM, ORDERS
from .pack import colour_bytes, extension_bytes, header_bytes

Blocks = Iterable[np.ndarray | Tensor] | np.ndarray | Tensor


@dataclass(frozen=True, eq=False)
class FactorRows:
    """One factorization U SV^T to write, with matrices as a whole or in blocks of rows.

    Args:
        singular_values: singular values `[k]`, for information only: `right` contains them.
        left: U `[rows, k]`, one row for each pair d = view * L + light; in FMF for each (pair,
            channel), channel fastest.
        right: SV `[T, k]`, one row for each texel t = row * W + column, row 0 at the top.
    """

    singular_values: np.ndarray | Tensor
    left: Blocks
    right: Blocks


def write_factors(
    path: Path | str, header: Header, factors: Sequence[FactorRows], *, scalar: int = 4
) -> None:
    """Writes given factors, block by block; a failure leaves nothing.

    Args:
        path: file to write.
        header: header of the file; the newest version is written, whatever its version is, with
            the top row of pictures first unless `rows` is "bottom". The cosine flag is written as
            it is; factors are not changed.
        factors: one factorization for each channel in DFMF08FC, else a single one.
        scalar: bytes of a number in the file: 2, 4 or 8.

    Raises:
        ConfigError: the header has a field that its variant cannot hold.
        DataError: a factor does not fit the header or its type of number.
        OutputError: the file cannot be written.
    """
    check_settings(header, scalar)
    if len(factors) != header.factor_count:
        raise DataError(
            f"{len(factors)} pairs of factors were given to write a {header.variant} file; "
            f"expected {header.factor_count}."
        )
    if not all(len(part.singular_values) for part in factors):
        raise DataError("factors without a component were given to write; expected 1 or more.")
    with new_file(path) as temporary, temporary.open("wb") as stream:
        stream.write(header_bytes(header))
        if header.variant == DFMF:
            most = max(len(part.singular_values) for part in factors)
            stream.write(colour_bytes(header, most))
        elif header.variant == FMF12:
            stream.write(extension_bytes(header))
        for part in factors:
            _write_factorization(stream, header, part, SCALARS[scalar])


def check_settings(header: Header, scalar: int) -> None:
    """Checks that the variant of a header can hold it.

    Raises:
        ConfigError: the variant is not known or lacks a field, or a setting is out of its range.
    """
    variant = header.variant
    if variant not in VARIANTS:
        raise ConfigError(f"variant is {variant!r}; expected one of {', '.join(VARIANTS)}.")
    if scalar not in SCALARS:
        raise ConfigError(f"scalar is {scalar}; expected 2, 4 or 8 bytes for a number.")
    models = (RGB, LOG_Y_RATIOS) if variant == DFMF else (RGB,)
    if header.colour_model not in models:
        expected = " or ".join(map(str, models))
        raise ConfigError(
            f"colour_model is {header.colour_model} for a {variant} file; expected {expected}."
        )
    if header.rows not in (None, *ORDERS):
        raise ConfigError(f"rows is {header.rows!r}; expected {alternatives(ORDERS)}.")
    for key, given in (
        ("log_values", header.log_values),
        ("height_map", header.height_map is not None),
    ):
        if given and variant != FMF12:
            raise ConfigError(f"{key} was given for a {variant} file; only {FMF12} can hold it.")


def _write_factorization(
    stream: BinaryIO, header: Header, factors: FactorRows, dtype: np.dtype
) -> None:
    """Writes one factorization at the position of the stream, and goes to its end."""
    count = len(factors.singular_values)
    if header.variant == DFMF:
        stream.write(struct.pack("<BI", dtype.itemsize, count))
    else:
        stream.write(struct.pack("<IBI", count, dtype.itemsize, count))
    stream.write(struct.pack("<2I", header.factor_rows, header.texel_count))
    # Singular values may exceed float16; they are clipped, as no reader uses them.
    largest = np.finfo(dtype).max
    stream.write(_array(factors.singular_values).clip(max=largest).astype(dtype).tobytes())
    for _, block in _packed_blocks(factors.left, header.factor_rows, count, dtype, "U"):
        stream.write(block.data)
    base = stream.tell()
    for first, block in _packed_blocks(factors.right, header.texel_count, count, dtype, "SV"):
        _write_texels(stream, base, first, block, header)
    stream.seek(base + header.texel_count * count * dtype.itemsize)


def _packed_blocks(
    source: Blocks, rows: int, width: int, dtype: np.dtype, what: str
) -> Iterator[tuple[int, np.ndarray]]:
    """Blocks of a matrix as stored: (index of the first row, rows `[n, width]`).

    Raises:
        DataError: the shape is not `[rows, width]`, or the type cannot hold a number.
    """
    first = 0
    for block in [source] if isinstance(source, np.ndarray | Tensor) else source:
        array = _array(block)
        if array.ndim != 2 or array.shape[1] != width or first + len(array) > rows:
            break
        with np.errstate(over="ignore"):
            packed = np.ascontiguousarray(array, dtype=dtype)
        if not np.isfinite(packed).all():
            raise DataError(
                f"{what} holds a number that {dtype.itemsize} bytes cannot hold in its rows "
                f"{first} to {first + len(array) - 1}; expected finite ones up to "
                f"{float(np.finfo(dtype).max):g}; write with a larger scalar."
            )
        yield first, packed
        first += len(array)
    else:
        if first == rows:
            return
    raise DataError(f"{what} does not have the shape of its file; expected [{rows}, {width}].")


def _array(values: np.ndarray | Tensor) -> np.ndarray:
    """An array or tensor `[...]` as an array on the CPU."""
    return values.detach().cpu().numpy() if isinstance(values, Tensor) else np.asarray(values)


def _write_texels(
    stream: BinaryIO, base: int, first: int, block: np.ndarray, header: Header
) -> None:
    """Writes rows `[n, k]` of consecutive texels to their places in the order of the header.

    Args:
        stream: file.
        base: offset of the matrix in bytes.
        first: index of the first texel.
        block: rows of the texels.
        header: header of the file.
    """
    row_bytes = block[:1].nbytes
    start = 0
    while start < len(block):
        row, column = divmod(first + start, header.width)
        count = min(header.width - column, len(block) - start)
        place = header.height - 1 - row if header.rows == BOTTOM else row
        stream.seek(base + (place * header.width + column) * row_bytes)
        stream.write(block[start : start + count].data)
        start += count
