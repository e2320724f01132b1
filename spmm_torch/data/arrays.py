"""Arrays of values `[V, L, H, W, 3]`, in memory or in a file, as a BTF opens them."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from ..errors import DataError
from .cache import entry_key
from .codes import FloatExpansion
from .directions import checked_directions
from .store import Loading, Part, Store
from .transpose import Place, ViewSource, open_store


@dataclass(frozen=True)
class ArrayHeader:
    """What the first bytes of an .npy tell."""

    shape: tuple[int, ...]
    fortran_order: bool
    dtype: np.dtype


def opener_in_memory(array: np.ndarray, where: str) -> Callable[[Part, Loading], Store]:
    """How a BTF opens an array `[V, L, H, W, 3]` in memory."""

    def views(chosen: Sequence[int]) -> Iterator[np.ndarray]:
        return (np.ascontiguousarray(array[view]) for view in chosen)

    def content() -> str:
        return hashlib.blake2b(np.ascontiguousarray(array).tobytes(), digest_size=20).hexdigest()

    return array_opener(ArrayHeader(array.shape, False, array.dtype), where, views, content)


def array_opener(
    header: ArrayHeader,
    where: str,
    views: Callable[[Sequence[int]], Iterator[np.ndarray]],
    content: Callable[[], object],
) -> Callable[[Part, Loading], Store]:
    """How a BTF opens an array whose pictures `[L, H, W, 3]` of ascending views `views` gives.

    Args:
        header: shape, order and type of the array `[V, L, H, W, 3]`.
        where: the array in words, for errors.
        views: the pictures of some views, in ascending order.
        content: something that equals for equal values only, to know decoded ones again by.
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

    return open_part


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


def numpy_values(values: np.ndarray | Tensor, where: str) -> np.ndarray:
    """The values of an array or tensor `[V, L, H, W, 3]` as NumPy has them, not copied.

    Raises:
        DataError: a type that NumPy does not have.
    """
    if not isinstance(values, Tensor):
        return values
    if values.dtype == torch.bfloat16:  # NumPy has no such type
        raise DataError(
            f"'values' of {where} has type bfloat16, 8 bits of which would be all that errors are "
            f"judged by; expected float16 or float32; measure or convert it in one of these."
        )
    return values.detach().cpu().numpy()
