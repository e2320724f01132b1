"""The store of a UBO2014 file: the values of a request are multiplied from their factors."""

from __future__ import annotations

import threading
from collections.abc import Sequence
from io import FileIO
from pathlib import Path

import torch
from torch import Tensor

from ...errors import DataError
from ..btf import CHUNK_VALUES
from ..store import Loading, Part, check_not_black, float_chunks
from .header import CHANNELS, Layout, RowsOf
from .product import LeftFactors, multiply
from .rows import finite_rows

# Texels whose factors are read at once, a few MB.
READ_TEXELS = 1024
# Texels whose highest value stands for that of all.
LEVEL_TEXELS = 64


def open_store(path: Path, layout: Layout, part: Part, loading: Loading) -> FactorStore:
    """The store of a part of a file; of `loading`, only its progress is used.

    Raises:
        DataError: all values are zero, or one that was computed is not finite.
    """
    header = layout.header
    views = torch.arange(len(header.view)) if part.views is None else part.views
    lights = torch.arange(len(header.light)) if part.lights is None else part.lights
    pairs = (views[:, None] * len(header.light) + lights).flatten()
    store = FactorStore(path, layout, part.texels, pairs)
    if not store.exceeds(0.0):
        check_not_black(0.0, str(path))
    if loading.progress is not None:
        loading.progress(len(views), len(views))
    return store


class FactorStore:
    """Linear values of a UBO2014 file; a `data.store.Store`.

    It holds U, a few dozen MB, and reads only the requested rows of SV. Threads may share it. A
    value has the same bits in every request.

    Args:
        path: file.
        layout: layout of the file.
        texels: indices `[T']` of texels in their new order; None: all.
        pairs: indices `[D']` of direction pairs in their new order; None: all.
    """

    def __init__(
        self,
        path: Path,
        layout: Layout,
        texels: Tensor | None = None,
        pairs: Tensor | None = None,
    ) -> None:
        header = layout.header
        self._path = path
        self._layout = layout
        self._texels = _selected(header.texel_count, texels)  # [T'], indices in the file
        self._pairs = _selected(header.pair_count, pairs)  # [D'], indices in the file
        self._left: dict[torch.device, LeftFactors] = {}
        self._lock = threading.Lock()
        self._is_hdr: bool | None = None

    @property
    def is_hdr(self) -> bool:
        """Whether a value exceeds 1; the first call reads values until one does."""
        if self._is_hdr is None:
            self._is_hdr = self.exceeds(1.0)
        return self._is_hdr

    @property
    def level(self) -> float:
        """The highest value of some texels, spread over all; see `Store.level`."""
        count = len(self._texels)
        return float(self.texels(torch.arange(0, count, max(count // LEVEL_TEXELS, 1))).max())

    def exceeds(self, bound: float) -> bool:
        """Whether a value exceeds a bound; reads values until one does.

        Raises:
            DataError: as for `texels`.
        """
        chunk = max(CHUNK_VALUES // (len(self._pairs) * CHANNELS), 1)
        blocks = float_chunks(self, len(self._texels), chunk)
        return any(float(block.max()) > bound for block in blocks)

    def texels(
        self, index: Tensor | slice | None = None, device: torch.device | str = "cpu"
    ) -> Tensor:
        """Linear values `[n, D, C]` float32 of some texels, on a device.

        Raises:
            DataError: a factor or a value is not finite, or the file has changed.
        """
        texels = self._chosen(index)
        shape = (len(texels), len(self._pairs), CHANNELS)
        return self._expand(texels, 0, torch.empty(shape, device=device))

    def signals(
        self, index: Tensor | slice | None = None, device: torch.device | str = "cpu"
    ) -> Tensor:
        """Linear values `[n, C, D]` float32 of some texels, on a device.

        Raises:
            DataError: as for `texels`.
        """
        texels = self._chosen(index)
        values = torch.empty((len(texels), CHANNELS, len(self._pairs)), device=device)
        self._expand(texels, 0, values.transpose(1, 2))
        return values

    def pairs(self, start: int, stop: int) -> Tensor:
        """Linear values `[T, stop - start, C]` float32 of consecutive pairs, on the CPU.

        Raises:
            DataError: as for `texels`.
        """
        shape = (len(self._texels), stop - start, CHANNELS)
        return self._expand(self._texels, start, torch.empty(shape))

    def strips(
        self, texel: Tensor, view: Tensor, lights: int, device: torch.device | str = "cpu"
    ) -> Tensor:
        """Linear values `[N, L, C]` of texels `[N]`, each under all lights of its view `[N]`.

        Raises:
            DataError: as for `texels`.
        """
        values = torch.empty((len(texel), lights, CHANNELS), device=device)
        for each in torch.unique(view).tolist():  # the pairs of one view are multiplied at once
            where = torch.nonzero(view == each).squeeze(1)
            part = torch.empty((len(where), lights, CHANNELS), device=device)
            texels = self._texels[texel.cpu()[where]]
            values[where.to(device)] = self._expand(texels, each * lights, part)
        return values

    def _expand(self, texels: Tensor, start: int, values: Tensor) -> Tensor:
        """Fills `values [n, D', C]` of `texels [n]` of the file under the pairs from `start` on."""
        left = self._left_factors(values.device)
        if values.numel() == 0:
            return values
        with self._open() as stream:
            for part, out in zip(texels.split(READ_TEXELS), values.split(READ_TEXELS), strict=True):
                rows = self._layout.right_rows(part.numpy())
                right = [plane.to(values.device) for plane in _read_planes(stream, rows)]
                if not multiply(right, left, start, out) < torch.inf:  # NaN is not, either
                    raise self._not_finite(part, start, out)
        return values

    def _chosen(self, index: Tensor | slice | None) -> Tensor:
        """Indices `[n]` in the file of the texels of an index."""
        if isinstance(index, Tensor):
            index = index.cpu()
        return self._texels if index is None else self._texels[index]

    def _not_finite(self, texels: Tensor, start: int, values: Tensor) -> DataError:
        """The error for the first of `values [n, D', C]` that is not finite."""
        texel, pair, channel = (int(i) for i in (~values.isfinite()).nonzero()[0])
        return DataError(
            f"the factors of {self._path} multiply to {float(values[texel, pair, channel])} at "
            f"[texel {int(texels[texel])}, pair {int(self._pairs[start + pair])}, channel "
            f"{channel}]; expected finite values; the file is damaged: copy it again from where "
            f"it came."
        )

    def _left_factors(self, device: torch.device) -> LeftFactors:
        """U on a device, read at first use."""
        with self._lock:
            if device not in self._left:
                self._left[device] = self._read_left().to(device)
            return self._left[device]

    def _read_left(self) -> LeftFactors:
        """U of the pairs of this store, on the CPU."""
        with self._open() as stream:
            planes = _read_planes(stream, self._layout.left_rows(self._pairs.numpy()))
        encoding = self._layout.header.encoding
        return LeftFactors.build(planes * (CHANNELS // len(planes)), encoding)

    def _open(self) -> FileIO:
        """The file, opened for one thread; unbuffered, as rows are read in whole runs."""
        try:
            return self._path.open("rb", buffering=0)
        except OSError as error:
            raise DataError(
                f"{self._path} cannot be read any more ({error}); expected it to stay as it is "
                f"while in use; restore it and start again."
            ) from error


def _read_planes(stream: FileIO, rows: Sequence[RowsOf]) -> list[Tensor]:
    """Factors `[n, k]` of some rows: of each channel, or one of all channels."""
    return [finite_rows(stream, matrix, wanted) for matrix, wanted in rows]


def _selected(count: int, index: Tensor | None) -> Tensor:
    """The numbers from 0 to count - 1 at an index `[n]`; None: all `[count]`."""
    numbers = torch.arange(count)
    return numbers if index is None else numbers[index.cpu()]
