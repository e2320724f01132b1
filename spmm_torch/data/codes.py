"""Codes: the values of a BTF as its source stores them, in memory or in a file.

They keep the bits of the source, 1 byte a value for 8-bit pictures and 4 bytes a pixel for RGBE:
smaller than floats, and without loss.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from io import FileIO
from pathlib import Path
from typing import Protocol

import numpy as np
import torch
from torch import Tensor

from ..errors import OutputError
from .file_rows import RowLayout, read_columns, read_rows

# Indices `[n]` of texels, a mask `[T]`, or a slice; None: all texels.
Index = Tensor | slice | None


class Codes(Protocol):
    """Codes of T texels under D direction pairs, with B code elements a pixel."""

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
class ViewCodes:
    """Codes in memory, view by view: `[V, T, L, B]`.

    Pictures come view by view and are read so again, where pages of memory lie side by side. A
    texel is read in V pieces, of L lights each.
    """

    codes: Tensor

    def rows(self, index: Index) -> Tensor:
        """Codes `[n, D, B]`; see `Codes.rows`."""
        if index is None or isinstance(index, slice):
            found = self.codes[:, slice(None) if index is None else index]
        else:
            found = self.codes.index_select(1, positions(index))
        return found.transpose(0, 1).flatten(1, 2)

    def columns(self, start: int, stop: int) -> Tensor:
        """Codes `[T, stop - start, B]`; see `Codes.columns`."""
        lights = self.codes.shape[2]
        first = start // lights
        views = self.codes[first : max(-(-stop // lights), first + 1)]
        found = views[0] if len(views) == 1 else views.transpose(0, 1).flatten(1, 2)
        return found[:, start - first * lights : stop - first * lights]

    def strips(self, texel: Tensor, view: Tensor, lights: int) -> Tensor:
        """Codes `[N, L, B]`; see `Codes.strips`."""
        _, texels, _, width = self.codes.shape
        table = self.codes.view(-1, lights * width)  # [V T, L B]
        return table.index_select(0, view * texels + texel).view(-1, lights, width)


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
