"""Arrays of values `[V, L, H, W, 3]`, in memory or in a file, as the source of a BTF."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
import torch
from numpy.typing import ArrayLike
from torch import Tensor

from ..errors import DataError
from .cache import KEY_BYTES, entry_key
from .directions import checked_directions
from .expansion import FloatExpansion
from .store import Loading, Part, Store
from .transpose import Place, ViewSource, open_store


@dataclass(frozen=True)
class ArrayHeader:
    """Shape, order and type of an array, from the header of an .npy file."""

    shape: tuple[int, ...]
    fortran_order: bool
    dtype: np.dtype


def opener_in_memory(array: np.ndarray, where: str) -> Callable[[Part, Loading], Store]:
    """The function by which a BTF opens an array `[V, L, H, W, 3]` in memory.

    Args:
        array: linear cosine-weighted values.
        where: name of the array in errors.
    """

    def views(chosen: Sequence[int]) -> Iterator[np.ndarray]:
        return (np.ascontiguousarray(array[view]) for view in chosen)

    content = partial(array_hash, array)
    return array_opener(ArrayHeader(array.shape, False, array.dtype), where, views, content)


def array_hash(array: np.ndarray) -> str:
    """The hash of the values of an array `[...]`, in hexadecimal, whatever its strides."""
    plain = np.ascontiguousarray(array)
    return hashlib.blake2b(plain.view(np.uint8).data, digest_size=KEY_BYTES).hexdigest()


def array_opener(
    header: ArrayHeader,
    where: str,
    views: Callable[[Sequence[int]], Iterator[np.ndarray]],
    content: Callable[[], object],
) -> Callable[[Part, Loading], Store]:
    """The function by which a BTF opens an array `[V, L, H, W, 3]` that is read view by view.

    Args:
        header: shape, order and type of the array.
        where: name of the array in errors.
        views: function that gives the pictures `[L, H, W, 3]` of each of some ascending views.
        content: function that gives a fingerprint of the values, for the key in the cache.
    """
    view_count, all_lights, height, width, _ = header.shape

    def open_part(part: Part, loading: Loading) -> Store:
        chosen = list(range(view_count)) if part.views is None else part.views.tolist()
        lights = slice(None) if part.lights is None else part.lights.numpy()
        texels = slice(None) if part.texels is None else part.texels.numpy()
        count = height * width if part.texels is None else len(part.texels)
        light_count = all_lights if part.lights is None else len(part.lights)
        native = header.dtype.newbyteorder("=")

        def decode(wanted: Sequence[int], place: Place) -> None:
            order = sorted(wanted, key=lambda index: chosen[index])
            for target, pictures in zip(order, views([chosen[i] for i in order]), strict=True):
                flat = pictures.reshape(len(pictures), height * width, 3)
                # A read-only array is copied, as torch wants writable memory.
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

    return open_part


def check_layout(
    shape: Sequence[int],
    dtype: np.dtype,
    view: ArrayLike,
    light: ArrayLike,
    where: str,
) -> tuple[Tensor, Tensor]:
    """Checks the layout of values and their directions; gives `(view [V, 3], light [L, 3])`.

    Args:
        shape, dtype: shape and type of the values; expected `[V, L, H, W, 3]` float16 or float32.
        view, light: unit vectors `[V, 3]` and `[L, 3]`.
        where: name of the source in errors.

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
        vectors = _vectors(array, f"{key!r} of {where}")
        checked = checked_directions(vectors, f"{key!r} of {where}")
        if len(checked) != count:
            raise DataError(
                f"{key!r} of {where} holds {len(checked)} directions but 'values' has shape "
                f"{list(shape)}; expected {count}; make the two agree."
            )
        directions.append(checked)
    return directions[0], directions[1]


def _vectors(directions: ArrayLike, where: str) -> Tensor:
    """Directions `[N, 3]` on the CPU, from a tensor, an array of any strides, or nested lists.

    Raises:
        DataError: they are not numbers, or rows differ in length.
    """
    if isinstance(directions, Tensor):
        return directions.detach().cpu()
    return torch.from_numpy(np.ascontiguousarray(_numbers(directions, where)))


def _numbers(values: ArrayLike, where: str) -> np.ndarray:
    """Nested lists, or whatever else NumPy takes, as an array `[...]` of numbers.

    Raises:
        DataError: they are not numbers, or rows differ in length.
    """
    try:
        array = np.asarray(values)
        if not np.issubdtype(array.dtype, np.number):
            raise ValueError(f"it has type {array.dtype}")
    except (ValueError, TypeError) as error:
        raise DataError(
            f"{where} is no array of numbers ({error}); expected an array, a tensor or lists of "
            f"equal length; convert it with numpy.asarray."
        ) from error
    return array.astype(array.dtype.newbyteorder("="), copy=False)


def numpy_values(values: ArrayLike, where: str) -> np.ndarray:
    """Values `[V, L, H, W, 3]` as a NumPy array, without a copy where they are on the CPU.

    Lists become float32.

    Raises:
        DataError: they are no numbers, or NumPy has no such type.
    """
    if isinstance(values, np.ndarray):
        return values
    if not isinstance(values, Tensor):
        return _numbers(values, f"'values' of {where}").astype(np.float32)
    if values.dtype == torch.bfloat16:  # NumPy has no such type
        raise DataError(
            f"'values' of {where} has type bfloat16, whose 8 bits are too few to measure errors "
            f"by; expected float16 or float32; measure or convert it in one of these."
        )
    return values.detach().cpu().numpy()
