"""Reader of the NPZ interchange format, view by view.

Arrays: `values [V, L, H, W, 3]` float16 or float32, linear and cosine-weighted; `view [V, 3]`
and `light [L, 3]`, unit vectors that point away from the surface; `names [H * W]`, texts, only
where texels are materials and no neighbours. A file is HDR if and only if a value exceeds 1; its
peak is then the 99.9th percentile, else 1.
"""

from __future__ import annotations

import io
import math
import zipfile
from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import IO, cast

import numpy as np
from numpy.lib import format as npy

from ..errors import DataError
from .arrays import ArrayHeader, array_opener, check_layout
from .btf import BTF
from .options import DEFAULT_OPTIONS, ReadOptions
from .pictures import ZIP_ERRORS, innermost_zip, list_files, material_name, open_zip

EXPECTED = "an NPZ with values, view and light"
MEMBERS = ("values", "view", "light")
NAMES = "names"
LAYOUT = "values [V, L, H, W, 3] float16 or float32, view [V, 3] and light [L, 3]"
# Largest ratio of the size of a zip member to its compressed size; other methods have no bound.
MAX_RATIO = {zipfile.ZIP_STORED: 1, zipfile.ZIP_DEFLATED: 1032}
READ_ERRORS = (*ZIP_ERRORS, OSError, ValueError, KeyError)


def accepts(path: Path) -> bool:
    """Whether a file is a zip with .npy arrays."""
    if path.is_dir() or not zipfile.is_zipfile(path):
        return False
    return any(name.endswith(".npy") for name in list_files(path))


def read(path: Path | str, options: ReadOptions = DEFAULT_OPTIONS) -> BTF:
    """Opens an NPZ: reads the directions and the header of the values, not the values.

    Values are linear, so that `options.gamma` has no effect.

    Raises:
        DataError: an array is missing or malformed, or a direction is not valid.
    """
    source = Path(path)
    try:
        header, view, light, names = _read_small_parts(source)
    except READ_ERRORS as error:
        raise _damaged(source, error) from error
    view, light = check_layout(header.shape, header.dtype, view, light, str(source))
    names = None if names is None else _checked_names(names, header.shape, source)
    views = partial(_iterate_views, source, header)
    key = partial(_content, source)
    _, _, height, width, _ = header.shape
    itemsize = header.dtype.itemsize
    opener = array_opener(header, f"'values' of {path}", views, key)
    name = material_name(source)
    return BTF(
        name,
        str(path),
        height,
        width,
        view,
        light,
        itemsize,
        opener,
        hdr=None,
        names=names,
        content=key,
    )


def _read_small_parts(
    path: Path,
) -> tuple[ArrayHeader, np.ndarray, np.ndarray, np.ndarray | None]:
    """Header of the values, views `[V, 3]`, lights `[L, 3]`, and names of texels if any."""
    with innermost_zip(path) as handle:
        members = handle.namelist()
        for key in MEMBERS:
            if f"{key}.npy" not in members:
                raise DataError(
                    f"{path} lacks the array {key!r}; expected {LAYOUT}; "
                    f"save it with numpy.savez under these names."
                )
        with handle.open("values.npy") as stream:
            header = _read_header(stream)
            _check_size(handle.getinfo("values.npy"), header, stream.tell())
        return (
            header,
            _read_directions(handle, "view", path),
            _read_directions(handle, "light", path),
            read_array(handle, NAMES) if f"{NAMES}.npy" in members else None,
        )


def _check_size(member: zipfile.ZipInfo, header: ArrayHeader, start: int) -> None:
    """Checks, before memory is allocated, that a member can hold the array of its header.

    Args:
        member: entry of the zip, whose sizes may be wrong.
        header: header of the array.
        start: number of bytes in front of the values.

    Raises:
        EOFError: the member is too small.
    """
    needed = start + math.prod(header.shape) * header.dtype.itemsize
    most = MAX_RATIO.get(member.compress_type, math.inf) * member.compress_size
    if needed > min(member.file_size, most):
        raise EOFError(
            f"the array ends early: {needed} bytes cannot come from {member.compress_size} bytes"
        )


def read_array(handle: zipfile.ZipFile, key: str) -> np.ndarray:
    """The whole array `[...]` of a member, `key` without its suffix."""
    with handle.open(f"{key}.npy") as stream:
        return npy.read_array(stream, allow_pickle=False)


def _checked_names(names: np.ndarray, shape: Sequence[int], path: Path) -> tuple[str, ...]:
    """The names of texels, one for each of the pictures of values `[V, L, H, W, 3]`."""
    count = shape[2] * shape[3]
    if names.dtype.kind != "U" or names.shape != (count,):
        raise DataError(
            f"{NAMES!r} of {path} has type {names.dtype} and shape {list(names.shape)}; expected "
            f"[{count}] texts, one a texel; leave it out where texels are a texture."
        )
    return tuple(names.tolist())


def _read_directions(handle: zipfile.ZipFile, key: str, path: Path) -> np.ndarray:
    """The array `[N, 3]` float64 of a member; its shape is checked elsewhere."""
    array = read_array(handle, key)
    if array.dtype.kind != "f":
        raise DataError(
            f"{key!r} of {path} has type {array.dtype}; expected float unit vectors [N, 3]; "
            f"convert it with astype."
        )
    return array.astype(np.float64)


def _read_header(stream: IO[bytes]) -> ArrayHeader:
    """The header at the start of an .npy file."""
    version = npy.read_magic(stream)
    if version not in ((1, 0), (2, 0)):
        raise ValueError(f"'values' has version {version} of the .npy format")
    parse = npy.read_array_header_1_0 if version == (1, 0) else npy.read_array_header_2_0
    return ArrayHeader(*parse(stream))


def _iterate_views(path: Path, header: ArrayHeader, chosen: Sequence[int]) -> Iterator[np.ndarray]:
    """Pictures `[L, H, W, 3]` of some ascending views, read one view at a time.

    In Fortran order the values of a view are all over the file, which is then read as a whole.
    """
    native = header.dtype.newbyteorder("=")
    shape = header.shape[1:]
    size = math.prod(shape) * header.dtype.itemsize
    try:
        with innermost_zip(path) as handle, handle.open("values.npy") as stream:
            _read_header(stream)
            start = stream.tell()
            if header.fortran_order:
                flat = np.frombuffer(stream.read(), dtype=header.dtype)
                values = flat.reshape(header.shape, order="F")
                yield from (np.ascontiguousarray(values[v], dtype=native) for v in chosen)
                return
            for view in chosen:
                stream.seek(start + view * size)
                payload = bytearray(size)
                if cast("io.BufferedIOBase", stream).readinto(payload) != size:
                    raise EOFError("the array ends early")
                pictures = np.frombuffer(payload, dtype=header.dtype).reshape(shape)
                yield pictures.astype(native, copy=False)
            if chosen and chosen[-1] == header.shape[0] - 1:
                stream.read(1)  # the end of a member verifies its checksum
    except READ_ERRORS as error:
        raise _damaged(path, error) from error


def _content(path: Path) -> list[tuple[str, int]]:
    """Names and checksums of the members of a zip."""
    with open_zip(path) as handle:
        return [(info.filename, info.CRC) for info in handle.infolist()]


def _damaged(path: Path, error: Exception) -> DataError:
    reason = str(error).partition("\n")[0].rstrip(".")  # the rest is advice to whoever programs
    return DataError(
        f"{path} cannot be read ({reason}); expected an NPZ with {LAYOUT}, without pickled "
        f"objects; save it again with numpy.savez."
    )
