"""What holds the values of a decoded BTF: texel-major, in the bit depth of the source."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import Protocol

import numpy as np
import torch
from torch import Tensor

from ..errors import DataError

Progress = Callable[[int, int], None]  # (views done, views in all)

# Codes that are looked up at once: their index and their result stay in the second-level cache.
LOOKUP_CHUNK = 1 << 17


class Store(Protocol):
    """The one thing a reader must give to a `BTF` besides its header."""

    is_hdr: bool

    def texels(self, index: Tensor | slice | None, device: torch.device | str) -> Tensor:
        """Linear values `[n, D, C]` float32 of some texels, on a device."""
        ...

    def pairs(self, start: int, stop: int) -> Tensor:
        """Linear values `[T, stop - start, C]` float32 of consecutive pairs, on the CPU."""
        ...


@dataclass(frozen=True)
class ArrayStore:
    """Values in memory: `codes [T, D, C]` uint8 with a `table [256]`, or floats without one."""

    codes: Tensor
    table: Tensor | None
    is_hdr: bool

    def texels(self, index: Tensor | slice | None, device: torch.device | str = "cpu") -> Tensor:
        return self._expand(self._rows(index).to(device))  # codes travel, not floats

    def pairs(self, start: int, stop: int) -> Tensor:
        return self._expand(self.codes[:, start:stop])

    def _rows(self, index: Tensor | slice | None) -> Tensor:
        if index is None:
            return self.codes
        if isinstance(index, slice):
            return self.codes[index]
        index = index.to(self.codes.device)
        if index.dtype == torch.bool:
            index = index.nonzero().flatten()
        return self.codes.index_select(0, index)

    def _expand(self, codes: Tensor) -> Tensor:
        """Float32 values of some codes, by table where there is one.

        A table, unlike a power, gives the same bits wherever a value lies in its block, so a
        fit does not depend on the size of the blocks.
        """
        if self.table is None:
            return codes.float()
        if codes.device.type != "cpu":
            return self.table.to(codes.device)[codes.int()]
        return _look_up(self.table, codes)


def _look_up(table: Tensor, codes: Tensor) -> Tensor:
    """`table[codes]` on the CPU, several times faster than by torch.

    NumPy, because the many small parallel regions of torch stall where cores are shared.
    """
    values = torch.empty(codes.shape, dtype=torch.float32)
    source, target, entries = codes.reshape(-1).numpy(), values.view(-1).numpy(), table.numpy()
    for start in range(0, source.size, LOOKUP_CHUNK):
        block = slice(start, start + LOOKUP_CHUNK)
        np.take(entries, source[block], out=target[block], mode="clip")  # "raise" would copy
    return values


def gamma_table(gamma: float) -> Tensor:
    """The linear value `(code / 255) ** gamma` of each 8-bit code: `[256]` float32."""
    return ((torch.arange(256, dtype=torch.float64) / 255.0) ** gamma).float()


def store_from_views(
    views: Iterable[np.ndarray],
    shape: tuple[int, int, int, int],
    dtype: torch.dtype,
    where: str,
    progress: Progress | None = None,
) -> ArrayStore:
    """Collect linear pictures, one view at a time, into a texel-major store.

    Args:
        views: for each view its pictures `[L, H, W, 3]`, float16 or float32.
        shape: (V, L, H, W).
        dtype: type to keep in memory.
        where: what the values are called in messages.
        progress: told (views done, V) after each view.

    Raises:
        DataError: a value is NaN, infinite or negative, or all values are zero.
    """
    view_count, light_count, height, width = shape
    codes = torch.empty((height * width, view_count * light_count, 3), dtype=dtype)
    maximum = 0.0
    for view, pictures in enumerate(views):
        block = torch.from_numpy(pictures)  # [L, H, W, 3]
        maximum = max(maximum, _checked_maximum(block, view, where))
        first = view * light_count
        codes[:, first : first + light_count] = block.reshape(light_count, -1, 3).transpose(0, 1)
        if progress is not None:
            progress(view + 1, view_count)
    check_not_black(maximum, where)
    return ArrayStore(codes, None, is_hdr=maximum > 1.0)


def _checked_maximum(block: Tensor, view: int, where: str) -> float:
    """The largest value of one view's pictures `[L, H, W, 3]`, all of which must be valid."""
    low, high = (float(bound) for bound in block.aminmax())  # both are NaN if any value is
    if low >= 0.0 and high < float("inf"):
        return high
    bad = ~(block.isfinite() & (block >= 0))
    light, row, column, channel = (int(i) for i in bad.nonzero()[0])
    raise DataError(
        f"{where} holds {float(block[light, row, column, channel])} at "
        f"[view {view}, light {light}, row {row}, column {column}, channel {channel}]; expected "
        f"finite values that are not negative; mend or replace those values before saving."
    )


def check_not_black(maximum: float, where: str) -> None:
    """Refuse a BTF that reflects nothing: no model, and no error in decibels, exists for it."""
    if maximum <= 0.0:
        raise DataError(
            f"{where} is all black; expected at least one value above zero; "
            f"check how the pictures were exposed or converted."
        )


def float_chunks(store: Store, texel_count: int, chunk: int) -> Iterator[Tensor]:
    """All values of a store in blocks of `chunk` texels, `[n, D, C]` each."""
    for start in range(0, texel_count, chunk):
        yield store.texels(slice(start, start + chunk), "cpu")
