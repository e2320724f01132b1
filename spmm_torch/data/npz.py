"""Reader of the NPZ interchange format, view by view.

Arrays: `values [V, L, H, W, 3]` float16 or float32, linear and cosine-weighted; `view [V, 3]`
and `light [L, 3]`, unit vectors that point away from the surface. A file counts as HDR if and
only if a value exceeds 1; its peak is then the 99.9th percentile, else 1.
"""

from __future__ import annotations

import hashlib
import math
import zipfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import IO

import numpy as np
import torch
from numpy.lib import format as npy
from torch import Tensor

from ..errors import DataError
from .btf import BTF
from .cache import entry_key
from .codes import FloatExpansion
from .directions import checked_directions
from .options import DEFAULT_OPTIONS, ReadOptions
from .pictures import ZIP_ERRORS, material_name, open_zip
from .store import Loading, Part, Store
from .transpose import Place, ViewSource, open_store

MEMBERS = ("values", "view", "light")
LAYOUT = "values [V, L, H, W, 3] float16 or float32, view [V, 3] and light [L, 3]"
# Deflate makes nothing smaller than by this factor.
DEFLATE_RATIO = 1032
READ_ERRORS = (*ZIP_ERRORS, OSError, ValueError, KeyError)


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
    views = partial(_iterate_views, source, header)
    key = partial(_content, source)
    return _btf(
        material_name(source), str(path), header, view, light, f"'values' of {path}", views, key
    )


def btf_of_array(
    values: np.ndarray | Tensor, view: Tensor, light: Tensor, name: str, negative: str
) -> BTF:
    """A BTF of values `[V, L, H, W, 3]` in memory; `negative` is that of `ReadOptions`.

    Raises:
        DataError: the shape or type of the values is wrong, or a direction is not valid.
    """
    where = f"the array of BTF {name!r}"
    array = _numpy(values, where)
    view, light = check_layout(array.shape, array.dtype, view, light, where)
    header = ArrayHeader(array.shape, False, array.dtype)

    def views(chosen: Sequence[int]) -> Iterator[np.ndarray]:
        return (np.ascontiguousarray(array[view]) for view in chosen)

    def key() -> str:
        return hashlib.blake2b(np.ascontiguousarray(array).tobytes(), digest_size=20).hexdigest()

    btf = _btf(name, "", header, view, light, where, views, key)
    return replace(btf, negative=ReadOptions(negative=negative).negative).load()


def _numpy(values: np.ndarray | Tensor, where: str) -> np.ndarray:
    if not isinstance(values, Tensor):
        return values
    if values.dtype == torch.bfloat16:  # NumPy has no such type
        raise DataError(
            f"'values' of {where} has type bfloat16, 8 bits of which would be all that errors are "
            f"judged by; expected float16 or float32; measure or convert it in one of these."
        )
    return values.detach().cpu().numpy()


def _btf(
    name: str,
    path: str,
    header: ArrayHeader,
    view: Tensor,
    light: Tensor,
    where: str,
    views: Callable[[Sequence[int]], Iterator[np.ndarray]],
    content: Callable[[], object],
) -> BTF:
    """A BTF whose pictures `[L, H, W, 3]` of ascending views are given by `views(chosen)`."""
    _, _, height, width, _ = header.shape

    def open_part(part: Part, loading: Loading) -> Store:
        chosen = list(range(len(view))) if part.views is None else part.views.tolist()
        lights = slice(None) if part.lights is None else part.lights.numpy()
        texels = slice(None) if part.texels is None else part.texels.numpy()
        count = height * width if part.texels is None else len(part.texels)
        light_count = len(light) if part.lights is None else len(part.lights)
        native = header.dtype.newbyteorder("=")

        def decode(wanted: Sequence[int], place: Place) -> None:
            order = sorted(wanted, key=lambda place_of: chosen[place_of])
            for target, pictures in zip(order, views([chosen[i] for i in order]), strict=True):
                flat = pictures.reshape(len(pictures), height * width, 3)
                # Of an array in memory that is read-only, a copy: torch asks for one to write to.
                place(target, np.require(flat[lights][:, texels], native, ("C", "W")))

        def key() -> str:
            kept = [
                None if x is None else x.tolist() for x in (part.texels, part.views, part.lights)
            ]
            return entry_key((content(), header.shape, str(header.dtype), kept))

        shape = (len(chosen), light_count, count, 3)
        columns = width if part.texels is None else 0
        source = ViewSource(where, shape, native, FloatExpansion(), decode, key, columns)
        return open_store(source, loading)

    itemsize = header.dtype.itemsize
    return BTF(name, path, height, width, view, light, itemsize, open_part, hdr=None)


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
    if len(shape) != 5 or shape[-1] != 3 or min(shape) < 1:
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
            needed = stream.tell() + math.prod(header.shape) * header.dtype.itemsize
        if handle.getinfo("values.npy").file_size < needed:  # before anyone makes room for it
            raise EOFError("the array ends early")
        return (
            header,
            _read_directions(handle, "view", path),
            _read_directions(handle, "light", path),
        )


def _check_size(member: zipfile.ZipInfo, header: ArrayHeader, path: Path) -> None:
    """Before any memory is taken: whether the member can hold the array that its header names."""
    claimed = math.prod(header.shape) * header.dtype.itemsize
    most = min(member.compress_size, path.stat().st_size) * DEFLATE_RATIO
    if claimed > min(member.file_size, most):
        raise EOFError(f"{claimed} bytes of values cannot come from {member.compress_size} bytes")


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


def _iterate_views(path: Path, header: ArrayHeader, chosen: Sequence[int]) -> Iterator[np.ndarray]:
    """Pictures `[L, H, W, 3]` of ascending views, so that never more than one is in memory twice.

    Arrays in Fortran order scatter a view over the whole file and are read in one piece.
    """
    native = header.dtype.newbyteorder("=")
    shape = header.shape[1:]
    size = math.prod(shape) * header.dtype.itemsize
    try:
        with zipfile.ZipFile(path) as handle, handle.open("values.npy") as stream:
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
                if stream.readinto(payload) != size:
                    raise EOFError("the array ends early")
                pictures = np.frombuffer(payload, dtype=header.dtype).reshape(shape)
                yield pictures.astype(native, copy=False)
            if chosen and chosen[-1] == header.shape[0] - 1:
                stream.read(1)  # only at its end does a member show that it is whole
    except READ_ERRORS as error:
        raise _damaged(path, error) from error


def _content(path: Path) -> list[tuple[str, int]]:
    """What a zip says of the content of its members."""
    with open_zip(path) as handle:
        return [(info.filename, info.CRC) for info in handle.infolist()]


def _damaged(path: Path, error: Exception) -> DataError:
    return DataError(
        f"{path} cannot be read ({error}); expected an NPZ with {LAYOUT}, without pickled objects; "
        f"save it again with numpy.savez."
    )
