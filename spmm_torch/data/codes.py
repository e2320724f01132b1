"""Codes: the values of a BTF as its source stores them, and their expansion to linear floats.

Codes are texel-major, `[T, D, B]` with B code elements a pixel, in memory or in a file. They keep
the bits of the source, 1 byte a value for 8-bit pictures and 4 bytes a pixel for RGBE: smaller than
floats, and without loss.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from io import FileIO
from pathlib import Path
from typing import ClassVar, Protocol

import numpy as np
import torch
from torch import Tensor

from ..errors import OutputError
from ..runtime.memory import slices
from ..runtime.threads import in_threads
from .file_rows import RowLayout, read_columns, read_rows

# Pairs of codes that are looked up at once: few enough for the caches of a core, enough that
# threads seldom wait for the interpreter's lock.
LOOKUP_CHUNK = 1 << 17

# Indices `[n]` of texels, a mask `[T]`, or a slice; None: all texels.
Index = Tensor | slice | None


class Codes(Protocol):
    """Texel-major codes `[T, D, B]`."""

    def rows(self, index: Index) -> Tensor:
        """Codes `[n, D, B]` of some texels, on the CPU; not to be written to."""
        ...

    def columns(self, start: int, stop: int) -> Tensor:
        """Codes `[T, stop - start, B]` of all texels under consecutive direction pairs."""
        ...

    def strips(self, texel: Tensor, view: Tensor, lights: int) -> Tensor:
        """Codes `[N, L, B]` of texels `[N]`, each under all L lights of its view `[N]`."""
        ...


@dataclass(frozen=True)
class MemoryCodes:
    """Codes `[T, D, B]` in memory."""

    codes: Tensor

    def rows(self, index: Index) -> Tensor:
        """Codes `[n, D, B]`; see `Codes.rows`."""
        if index is None:
            return self.codes
        if isinstance(index, slice):
            return self.codes[index]
        return self.codes.index_select(0, positions(index))

    def columns(self, start: int, stop: int) -> Tensor:
        """Codes `[T, stop - start, B]`; see `Codes.columns`."""
        return self.codes[:, start:stop]

    def strips(self, texel: Tensor, view: Tensor, lights: int) -> Tensor:
        """Codes `[N, L, B]`; see `Codes.strips`."""
        _, pairs, width = self.codes.shape
        table = self.codes.view(-1, lights * width)  # [T V, L B]
        return table.index_select(0, texel * (pairs // lights) + view).view(-1, lights, width)


@dataclass(frozen=True)
class FileCodes:
    """Codes `[T, D, B]` in a `.npy` file."""

    path: Path

    @cached_property
    def shape(self) -> tuple[int, ...]:
        """The shape (T, D, B) of the codes.

        Raises:
            OutputError: the file is gone or damaged.
        """
        return self._header[0]

    def rows(self, index: Index) -> Tensor:
        """Codes `[n, D, B]`; see `Codes.rows`.

        Raises:
            OutputError: the file is gone or damaged.
        """
        texels = np.arange(self.shape[0])
        chosen = slice(None) if index is None else index
        chosen = texels[chosen if isinstance(chosen, slice) else positions(chosen).numpy()]
        codes = self._read(lambda stream: read_rows(stream, self._layout, chosen))
        return codes.view(len(chosen), *self.shape[1:])

    def columns(self, start: int, stop: int) -> Tensor:
        """Codes `[T, stop - start, B]`; see `Codes.columns`.

        Raises:
            OutputError: the file is gone or damaged.
        """
        texels, _, width = self.shape
        codes = self._read(
            lambda stream: read_columns(stream, self._layout, texels, start * width, stop * width)
        )
        return codes.view(texels, stop - start, width)

    def strips(self, texel: Tensor, view: Tensor, lights: int) -> Tensor:
        """Codes `[N, L, B]`; see `Codes.strips`.

        Raises:
            OutputError: the file is gone or damaged.
        """
        _, pairs, width = self.shape
        rows = (texel * (pairs // lights) + view).numpy()
        layout = replace(self._layout, width=lights * width)
        return self._read(lambda stream: read_rows(stream, layout, rows)).view(-1, lights, width)

    @cached_property
    def _header(self) -> tuple[tuple[int, ...], np.dtype, int]:
        """Shape and type of the codes, and the offset of the first one in bytes."""
        try:
            mapped = np.lib.format.open_memmap(self.path, mode="r")
        except (OSError, ValueError) as error:
            raise self._gone(error) from error
        return mapped.shape, mapped.dtype, mapped.offset

    @property
    def _layout(self) -> RowLayout:
        shape, dtype, offset = self._header
        return RowLayout(offset, dtype, math.prod(shape[1:]))

    def _read(self, read: Callable[[FileIO], np.ndarray]) -> Tensor:
        try:
            with self._open() as stream:
                return torch.from_numpy(read(stream))
        except EOFError as error:
            raise self._gone(error) from error

    def _open(self) -> FileIO:
        try:
            return self.path.open("rb", buffering=0)
        except OSError as error:
            raise self._gone(error) from error

    def _gone(self, error: Exception) -> OutputError:
        return OutputError(
            f"the decoded values in {self.path} cannot be read any more ({error}); expected "
            f"them to stay while they are in use; start again."
        )


def positions(index: Tensor) -> Tensor:
    """Positions `[n]` on the CPU of a texel index `[n]` or a mask of texels `[T]`."""
    index = index.cpu()
    return index.nonzero().flatten() if index.dtype == torch.bool else index


class Expansion(Protocol):
    """The expansion of codes to linear values.

    Attributes:
        elementwise: whether every code element stands for one value.
    """

    elementwise: ClassVar[bool]

    def __call__(self, codes: Tensor) -> Tensor:
        """Linear values `[..., C]` float32 of codes `[..., B]`, on the device of the codes."""
        ...

    def bounds(self, codes: Tensor) -> tuple[float, float]:
        """The lowest and the highest value of codes `[..., B]`; both are NaN if any value is."""
        ...


class FloatExpansion:
    """The expansion of float16 or float32 codes, which are linear values already."""

    elementwise: ClassVar[bool] = True

    def __call__(self, codes: Tensor) -> Tensor:
        """Values `[..., C]` float32 of codes `[..., C]`."""
        return codes.float()

    def bounds(self, codes: Tensor) -> tuple[float, float]:
        """The lowest and the highest value of codes `[..., C]`; see `Expansion.bounds`."""
        low, high = codes.aminmax()
        return float(low), float(high)


@dataclass(frozen=True)
class TableExpansion:
    """The expansion of codes of 8 or 16 bits by a rising `table [256]` or `[65536]`.

    A table, unlike a power, gives the same bits at any place of a block, so that a fit does not
    depend on the size of blocks. On a CPU codes of 8 bits are looked up two at a time.
    """

    table: Tensor
    elementwise: ClassVar[bool] = True

    @cached_property
    def pairs(self) -> np.ndarray:
        """The two float32 values of every pair of codes `[65536]`, as one element of 8 bytes."""
        codes = np.arange(1 << 16, dtype=np.uint16).view(np.uint8)
        return self.table.numpy()[codes].view(np.uint64)

    def __call__(self, codes: Tensor) -> Tensor:
        """Values `[...]` float32 of codes `[...]` uint8 or uint16."""
        if codes.device.type != "cpu":
            return self.table.to(codes.device)[codes.int()]
        if codes.dtype == torch.uint16:
            return _look_up(self.table.numpy(), codes)
        return _look_up_pairs(self.table.numpy(), self.pairs, codes)

    def bounds(self, codes: Tensor) -> tuple[float, float]:
        """The lowest and the highest value of codes `[...]`; see `Expansion.bounds`."""
        array = codes.numpy()  # torch has no extrema of uint16
        return float(self.table[int(array.min())]), float(self.table[int(array.max())])

    @classmethod
    def gamma(cls, gamma: float, code_max: int = 255) -> TableExpansion:
        """The expansion of a code to `(code / code_max) ** gamma`."""
        codes = torch.arange(code_max + 1, dtype=torch.float64)
        return cls(((codes / code_max) ** gamma).float())


@dataclass(frozen=True)
class DepthExpansion:
    """The expansion of pictures of several depths, by the type of their codes.

    Codes of 8 and 16 bits were encoded with a display gamma; floats are linear values already.
    """

    gamma: float
    elementwise: ClassVar[bool] = True

    def __call__(self, codes: Tensor) -> Tensor:
        """Values `[..., C]` float32 of codes `[..., C]` uint8, uint16, float16 or float32."""
        return self._of_type[codes.dtype](codes)

    def bounds(self, codes: Tensor) -> tuple[float, float]:
        """The lowest and the highest value of codes `[..., C]`; see `Expansion.bounds`."""
        return self._of_type[codes.dtype].bounds(codes)

    @cached_property
    def _of_type(self) -> dict[torch.dtype, Expansion]:
        return {
            torch.uint8: TableExpansion.gamma(self.gamma),
            torch.uint16: TableExpansion.gamma(self.gamma, 65535),
            torch.float16: FloatExpansion(),
            torch.float32: FloatExpansion(),
        }


def _look_up(table: np.ndarray, codes: Tensor) -> Tensor:
    """`table[codes]` of codes `[...]` uint16 on the CPU, in threads."""
    values = torch.from_numpy(np.empty(codes.shape, np.float32))
    source, target = codes.contiguous().view(-1).numpy(), values.view(-1).numpy()

    def work(block: slice) -> None:
        np.take(table, source[block], out=target[block], mode="clip")  # "raise" would copy

    in_threads(work, list(slices(len(source), LOOKUP_CHUNK)))
    return values


def _look_up_pairs(table: np.ndarray, pairs: np.ndarray, codes: Tensor) -> Tensor:
    """`table[codes]` of codes `[...]` uint8 on the CPU, in threads, ten times as fast as by torch.

    `np.take` spends most of its time on the index, and here one index serves two codes.
    """
    values = torch.from_numpy(np.empty(codes.shape, np.float32))  # NumPy allocates huge pages
    source, target = codes.contiguous().view(-1).numpy(), values.view(-1).numpy()
    even = source.size & ~1
    source_pairs, target_pairs = source[:even].view(np.uint16), target[:even].view(np.uint64)

    def work(block: slice) -> None:
        # The mode "raise" would copy.
        np.take(pairs, source_pairs[block], out=target_pairs[block], mode="clip")

    in_threads(work, list(slices(len(source_pairs), LOOKUP_CHUNK)))
    target[even:] = table[source[even:]]
    return values
