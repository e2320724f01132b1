"""The NPZ interchange format, read view by view and written through a temporary name.

Arrays: `values [V, L, H, W, 3]` float16 or float32, linear and cosine-weighted; `view [V, 3]`
and `light [L, 3]`, unit vectors that point away from the surface. A file counts as HDR if and
only if a value exceeds 1; its peak is then the 99.9th percentile, else 1.
"""

from __future__ import annotations

import math
import os
import zipfile
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import IO

import numpy as np
import torch
from numpy.lib import format as npy
from torch import Tensor

from ..errors import DataError, OutputError
from .btf import BTF
from .directions import checked_directions
from .options import DEFAULT_OPTIONS, ReadOptions
from .pictures import ZIP_ERRORS, material_name, open_zip
from .store import ArrayStore, Progress, store_from_views

MEMBERS = ("values", "view", "light")
LAYOUT = "values [V, L, H, W, 3] float16 or float32, view [V, 3] and light [L, 3]"
READ_ERRORS = (*ZIP_ERRORS, OSError, ValueError)


@dataclass(frozen=True)
class ArrayHeader:
    """What the first bytes of an .npy tell."""

    shape: tuple[int, ...]
    fortran_order: bool
    dtype: np.dtype


def accepts(path: Path) -> bool:
    """Whether a file is a zip that holds .npy arrays."""
    if path.is_dir() or not zipfile.is_zipfile(path):
        return False
    with open_zip(path) as handle:
        return any(name.endswith(".npy") for name in handle.namelist())


def read(path: Path | str, options: ReadOptions = DEFAULT_OPTIONS) -> BTF:
    """Open an NPZ: reads the directions and the header of the values, not the values.

    Its values are linear, so `options.gamma` does not touch them.

    Raises:
        DataError: an array is missing or malformed, or a direction is not valid.
    """
    source = Path(path)
    try:
        header, view, light = _read_small_parts(source)
    except READ_ERRORS as error:
        raise _damaged(source, error) from error
    view, light = check_layout(header.shape, header.dtype, view, light, str(source))
    return BTF(
        name=material_name(source),
        path=str(path),
        height=header.shape[2],
        width=header.shape[3],
        view=view,
        light=light,
        bytes_per_value=header.dtype.itemsize,
        open_store=partial(_open_store, source),
        hdr=None,
    )


def check_layout(
    shape: Sequence[int],
    dtype: np.dtype,
    view: Tensor | np.ndarray,
    light: Tensor | np.ndarray,
    where: str,
) -> tuple[Tensor, Tensor]:
    """The checked directions `(view [V, 3], light [L, 3])` of values of a given shape.

    Raises:
        DataError: the shape or type of the values is wrong, or a direction is not valid.
    """
    if len(shape) != 5 or shape[-1] != 3 or 0 in shape:
        raise DataError(
            f"'values' of {where} has shape {list(shape)}; expected [V, L, H, W, 3] without an "
            f"empty axis; reorder its axes."
        )
    if dtype.kind != "f" or dtype.itemsize not in (2, 4):
        raise DataError(
            f"'values' of {where} has type {dtype}; expected float16 or float32 holding linear "
            f"cosine-weighted values; convert it with astype."
        )
    directions = []
    for key, array, count in (("view", view, shape[0]), ("light", light, shape[1])):
        vectors = torch.as_tensor(array).detach().cpu()
        checked = checked_directions(vectors, f"{key!r} of {where}")
        if len(checked) != count:
            raise DataError(
                f"{key!r} of {where} holds {len(checked)} directions but 'values' has shape "
                f"{list(shape)}; expected {count}; make the two agree."
            )
        directions.append(checked)
    return directions[0], directions[1]


def _read_small_parts(path: Path) -> tuple[ArrayHeader, np.ndarray, np.ndarray]:
    with zipfile.ZipFile(path) as handle:
        names = handle.namelist()
        for key in MEMBERS:
            if f"{key}.npy" not in names:
                raise DataError(
                    f"{path} lacks the array {key!r}; expected {LAYOUT}; "
                    f"save it with numpy.savez under these names."
                )
        with handle.open("values.npy") as stream:
            header = _read_header(stream)
        return (
            header,
            _read_directions(handle, "view", path),
            _read_directions(handle, "light", path),
        )


def _read_directions(handle: zipfile.ZipFile, key: str, path: Path) -> np.ndarray:
    with handle.open(f"{key}.npy") as stream:
        array = npy.read_array(stream, allow_pickle=False)
    if array.dtype.kind != "f":
        raise DataError(
            f"{key!r} of {path} has type {array.dtype}; expected float unit vectors [N, 3]; "
            f"convert it with astype."
        )
    return array.astype(np.float64)


def _read_header(stream: IO[bytes]) -> ArrayHeader:
    version = npy.read_magic(stream)
    if version not in ((1, 0), (2, 0)):
        raise ValueError(f"'values' has version {version} of the .npy format")
    parse = npy.read_array_header_1_0 if version == (1, 0) else npy.read_array_header_2_0
    return ArrayHeader(*parse(stream))


def _open_store(path: Path, progress: Progress | None) -> ArrayStore:
    try:
        with zipfile.ZipFile(path) as handle, handle.open("values.npy") as stream:
            header = _read_header(stream)
            dtype = torch.float16 if header.dtype.itemsize == 2 else torch.float32
            views = _iterate_views(stream, header)
            where = f"'values' of {path}"
            return store_from_views(views, header.shape[:4], dtype, where, progress)
    except READ_ERRORS as error:
        raise _damaged(path, error) from error


def _iterate_views(stream: IO[bytes], header: ArrayHeader) -> Iterator[np.ndarray]:
    """Pictures `[L, H, W, 3]` of each view, so that never more than one view is in memory twice.

    Arrays in Fortran order scatter a view over the whole file and are read in one piece.
    """
    native = header.dtype.newbyteorder("=")
    if header.fortran_order:
        flat = np.frombuffer(stream.read(), dtype=header.dtype)
        for pictures in flat.reshape(header.shape, order="F"):
            yield np.ascontiguousarray(pictures, dtype=native)
        return
    shape = header.shape[1:]
    size = math.prod(shape) * header.dtype.itemsize
    for _ in range(header.shape[0]):
        payload = bytearray(size)
        if stream.readinto(payload) != size:
            raise EOFError("the array ends early")
        yield np.frombuffer(payload, dtype=header.dtype).reshape(shape).astype(native, copy=False)


def _damaged(path: Path, error: Exception) -> DataError:
    return DataError(
        f"{path} cannot be read ({error}); expected an NPZ with {LAYOUT}, without pickled objects; "
        f"save it again with numpy.savez."
    )


def write_npz(path: Path | str, btf: BTF) -> None:
    """Write a BTF as NPZ; nothing is left at `path` unless all of it was written.

    float16 sources stay float16, all others become float32.

    Raises:
        OutputError: the file cannot be written.
    """
    destination = Path(path)
    temporary = destination.with_name(f".{destination.name}.{os.getpid()}.tmp")
    btf.load()
    try:
        _write_members(temporary, btf)
        os.replace(temporary, destination)
    except OSError as error:
        raise OutputError(
            f"{destination} cannot be written ({error}); expected a writable folder with enough "
            f"space; choose another place."
        ) from error
    finally:
        with suppress(OSError):
            temporary.unlink(missing_ok=True)


def _write_members(path: Path, btf: BTF) -> None:
    dtype = np.dtype("<f2") if btf.bytes_per_value == 2 else np.dtype("<f4")
    shape = (len(btf.view), len(btf.light), btf.height, btf.width, btf.channels)
    header = {"descr": npy.dtype_to_descr(dtype), "fortran_order": False, "shape": shape}
    with zipfile.ZipFile(path, "w", zipfile.ZIP_STORED) as handle:
        for key, vectors in (("view", btf.view), ("light", btf.light)):
            with handle.open(f"{key}.npy", "w") as stream:
                npy.write_array(stream, vectors.numpy(), allow_pickle=False)
        with handle.open("values.npy", "w", force_zip64=True) as stream:
            npy.write_array_header_1_0(stream, header)
            for view in range(len(btf.view)):
                stream.write(btf.pictures(view).numpy().astype(dtype, order="C").tobytes())
