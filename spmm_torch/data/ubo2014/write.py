"""Write UBO2014 files: given factors as a stream, or a BTF through a truncated decomposition."""

from __future__ import annotations

import struct
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

import numpy as np
import torch
from torch import Tensor

from ...errors import ConfigError, DataError
from ...runtime.atomic import new_file
from ..btf import BTF
from ..options import DEFAULT_COMPONENTS
from ..store import Progress
from .colour import LOG_YUV, RGB
from .factorize import factorize
from .header import DFMF, FMF12, SCALARS, VARIANTS, Header
from .pack import colour_bytes, extension_bytes, header_bytes

Blocks = Iterable[np.ndarray | Tensor] | np.ndarray | Tensor


@dataclass(frozen=True, eq=False)
class FactorRows:
    """One factorization U SV^T to write; its matrices may come in blocks of rows.

    Args:
        singular_values: `[k]`; for information only, they are multiplied into `right`.
        left: U `[rows, k]`: a row for each pair d = view * L + light; in FMF for each (pair,
            channel), channel fastest.
        right: SV `[T, k]`: a row for each texel t = row * W + column, row 0 at the top.
    """

    singular_values: np.ndarray | Tensor
    left: Blocks
    right: Blocks


def write_ubo2014(
    path: Path | str,
    btf: BTF,
    *,
    components: int = DEFAULT_COMPONENTS,
    scalar: int = 4,
    variant: str = DFMF,
    colour_model: int = RGB,
    log_values: bool = False,
    generator: torch.Generator | None = None,
    device: torch.device | str = "cpu",
    progress: Progress | None = None,
) -> None:
    """Write a BTF as a truncated singular value decomposition; nothing is left if that fails.

    The values are passed over a few times in blocks and never held as a whole.

    Args:
        components: how many of the largest ones to keep, for each pair of factors.
        scalar: bytes of a number in the file: 2, 4 or 8.
        variant: DFMF08FC (factors for each channel), FMF06FC or FMF12FCE (for all together).
        colour_model: 0 for RGB, 11 for log Y, U / Y, V / Y (DFMF08FC only).
        log_values: factor the logarithms of the values (FMF12FCE only).
        generator: of the random start of the decomposition; a fixed one by default.
        device: where to compute.
        progress: told (texels done, texels in all passes).

    Raises:
        ConfigError: a setting is out of its range.
        OutputError: the file cannot be written.
    """
    if components < 1:
        raise ConfigError(f"components is {components}; expected 1 or more.")
    header = Header(
        variant=variant,
        width=btf.width,
        height=btf.height,
        view=_angles(btf.view),
        light=_angles(btf.light),
        colour_model=colour_model,
        log_values=log_values,
    )
    _check_settings(header, scalar)
    factors = factorize(
        btf,
        components,
        joint=variant != DFMF,
        colour_model=colour_model,
        log_values=log_values,
        generator=generator or torch.Generator().manual_seed(0),
        dtype=torch.float64 if scalar == SCALARS[8].itemsize else torch.float32,
        device=torch.device(device),
        progress=progress,
    )
    write_factors(path, header, [FactorRows(*part) for part in factors], scalar=scalar)


def write_factors(
    path: Path | str, header: Header, factors: Sequence[FactorRows], *, scalar: int = 4
) -> None:
    """Write given factors, block by block; nothing is left at `path` if that fails.

    Args:
        header: its version is not used: the newest is written.
        factors: one for each channel in DFMF08FC, else one.
        scalar: bytes of a number in the file: 2, 4 or 8.

    Raises:
        ConfigError: the header asks for what its variant cannot hold.
        DataError: a factor does not fit its type of number, or the header.
        OutputError: the file cannot be written.
    """
    _check_settings(header, scalar)
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


def _angles(directions: Tensor) -> np.ndarray:
    """Polar angle and azimuth `[N, 2]` float32, radians, of unit vectors `[N, 3]`."""
    x, y, z = directions.double().unbind(-1)
    azimuth = torch.atan2(y, x).remainder(2.0 * torch.pi)
    return torch.stack((torch.atan2(torch.hypot(x, y), z), azimuth), dim=-1).float().numpy()


def _check_settings(header: Header, scalar: int) -> None:
    """Refuse what no file of the variant can hold."""
    variant = header.variant
    if variant not in VARIANTS:
        raise ConfigError(f"variant is {variant!r}; expected one of {', '.join(VARIANTS)}.")
    if scalar not in SCALARS:
        raise ConfigError(f"scalar is {scalar}; expected 2, 4 or 8 bytes for a number.")
    models = (RGB, LOG_YUV) if variant == DFMF else (RGB,)
    if header.colour_model not in models:
        expected = " or ".join(map(str, models))
        raise ConfigError(
            f"colour_model is {header.colour_model} for a {variant} file; expected {expected}."
        )
    for key, given in (
        ("log_values", header.log_values),
        ("height_map", header.height_map is not None),
    ):
        if given and variant != FMF12:
            raise ConfigError(f"{key} was given for a {variant} file; only {FMF12} can hold it.")


def _write_factorization(
    stream: BinaryIO, header: Header, factors: FactorRows, dtype: np.dtype
) -> None:
    count = len(factors.singular_values)
    if header.variant == DFMF:
        stream.write(struct.pack("<BI", dtype.itemsize, count))
    else:
        stream.write(struct.pack("<IBI", count, dtype.itemsize, count))
    stream.write(struct.pack("<2I", header.factor_rows, header.texel_count))
    # Nobody uses them, and those of large pictures exceed float16.
    largest = np.finfo(dtype).max
    stream.write(_array(factors.singular_values).clip(max=largest).astype(dtype).tobytes())
    for _, block in _packed_blocks(factors.left, header.factor_rows, count, dtype, "U"):
        stream.write(block)
    base = stream.tell()
    for first, block in _packed_blocks(factors.right, header.texel_count, count, dtype, "SV"):
        _write_texels(stream, base, first, block, header.width, header.height)
    stream.seek(base + header.texel_count * count * dtype.itemsize)


def _packed_blocks(
    source: Blocks, rows: int, width: int, dtype: np.dtype, what: str
) -> Iterator[tuple[int, np.ndarray]]:
    """(number of the first row, rows `[n, width]` as they are stored) of a matrix.

    Raises:
        DataError: not `rows` rows of `width`, or a number that the type cannot hold.
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
    return values.detach().cpu().numpy() if isinstance(values, Tensor) else np.asarray(values)


def _write_texels(
    stream: BinaryIO, base: int, first: int, block: np.ndarray, width: int, height: int
) -> None:
    """Put the rows `[n, k]` of consecutive texels where they belong: bottom picture row first.

    Args:
        base: where the matrix starts in the file.
        first: the first texel.
        width, height: of the pictures.
    """
    row_bytes = block[:1].nbytes
    start = 0
    while start < len(block):
        row, column = divmod(first + start, width)
        count = min(width - column, len(block) - start)
        stream.seek(base + ((height - 1 - row) * width + column) * row_bytes)
        stream.write(block[start : start + count])
        start += count
