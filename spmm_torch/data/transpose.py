"""Transposition of pictures, view by view, to codes in memory or in the cache."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import torch

from ..errors import DataError
from ..runtime.memory import slices
from .cache import CacheEntry, entry_key
from .codes import Codes, FileCodes, ViewCodes
from .expansion import Expansion
from .store import CodeStore, Loading, check_not_black

# Bytes of a band of views where no limit of memory was given: 1 GiB.
DEFAULT_BAND_BYTES = 1 << 30
# Fraction of the memory that a band may take: decoding and transposing need some beside it.
BAND_FRACTION = 0.5
# Texels that are transposed at once.
TRANSPOSED_TEXELS = 512

Place = Callable[[int, np.ndarray], None]  # (view, its codes [L, T, B])


@dataclass(frozen=True)
class ViewSource:
    """A source that is decoded view by view.

    Attributes:
        where: name of the source in messages.
        shape: (V, L, T, B) with B code elements a pixel.
        dtype: type of the codes.
        expand: expansion of the codes to values.
        decode: `decode(views, place)` calls `place(view, codes)` once for each of some ascending
            views, from any thread and in any order.
        key: function that gives the name of these codes in the cache.
        columns: width of the pictures if texels are stored row by row; else 0.
    """

    where: str
    shape: tuple[int, int, int, int]
    dtype: np.dtype
    expand: Expansion
    decode: Callable[[Sequence[int], Place], None]
    key: Callable[[], str]
    columns: int = 0

    @property
    def view_bytes(self) -> int:
        """Bytes of the codes of one view."""
        _, lights, texels, width = self.shape
        return lights * texels * width * self.dtype.itemsize

    @property
    def total_bytes(self) -> int:
        """Bytes of all codes."""
        return self.shape[0] * self.view_bytes


def open_store(source: ViewSource, loading: Loading) -> CodeStore:
    """The store of all views, decoded or found in the cache.

    Raises:
        DataError: a picture cannot be decoded, a value is not valid, or all are zero.
        OutputError: the cache cannot be written.
    """
    small = loading.memory is None or source.total_bytes <= loading.memory
    if loading.cache is None and small:
        codes, highest = _into_memory(source, loading)
    else:
        codes, highest = _into_cache(source, loading)
    check_not_black(highest, source.where)
    return CodeStore(codes, source.expand, highest)


def _into_memory(source: ViewSource, loading: Loading) -> tuple[Codes, float]:
    """All codes in memory, and the highest value."""
    views, lights, texels, width = source.shape
    codes = np.empty((views, texels, lights, width), dtype=source.dtype)
    placed = _Placed(source, loading, codes, first=0)
    source.decode(range(views), placed)
    return ViewCodes(torch.from_numpy(codes)), placed.highest


def _into_cache(source: ViewSource, loading: Loading) -> tuple[Codes, float]:
    """All codes in the cache, and the highest value.

    Views are decoded in bands that fit in memory; a killed run resumes after its last band.
    """
    views, lights, texels, width = source.shape
    budget = loading.memory * BAND_FRACTION if loading.memory is not None else DEFAULT_BAND_BYTES
    size = int(min(max(budget // source.view_bytes, 1), views))
    shape = (texels, views * lights, width)
    key = source.key()
    if loading.negative != "refuse":  # codes that other settings would clip, or refuse
        key = entry_key((key, loading.negative))
    with CacheEntry.open(loading.cache, key, source.where, shape, source.dtype) as entry:
        if not entry.complete:
            entry.reserve()
            for first in range(entry.views_done, views, size):
                band = range(first, min(first + size, views))
                codes = np.empty((texels, len(band) * lights, width), dtype=source.dtype)
                by_view = codes.reshape(texels, len(band), lights, width).swapaxes(0, 1)
                placed = _Placed(source, loading, by_view, first)
                source.decode(band, placed)
                highest = max(entry.highest, placed.highest)
                entry.put(codes, first * lights, views_done=band.stop, highest=highest)
            entry.finish()
        elif loading.progress is not None:
            loading.progress(views, views)
        return FileCodes(entry.path), entry.highest


class _Placed:
    """The codes `[v, T, L, B]` of consecutive views; called with the pictures of each view."""

    def __init__(self, source: ViewSource, loading: Loading, codes: np.ndarray, first: int) -> None:
        self.source, self.progress, self.negative = source, loading.progress, loading.negative
        self.codes, self.first = codes, first
        self.highest, self.done = 0.0, first
        self._lock = threading.Lock()

    def __call__(self, view: int, pictures: np.ndarray) -> None:
        """Checks the pictures `[L, T, B]` of a view and puts them in their place."""
        lowest = 0.0 if self.negative == "refuse" else -math.inf
        highest = _checked_highest(self.source, view, pictures, lowest)
        if self.negative == "clip" and pictures.dtype.kind == "f":
            pictures = np.maximum(pictures, 0)
        transpose_into(self.codes[view - self.first], pictures)
        with self._lock:
            self.highest = max(self.highest, highest)
            self.done += 1
            if self.progress is not None:
                self.progress(self.done, self.source.shape[0])


def _checked_highest(source: ViewSource, view: int, pictures: np.ndarray, lowest: float) -> float:
    """The highest value of a view's codes `[L, T, B]`: all finite, and none below `lowest`."""
    codes = torch.from_numpy(pictures)
    low, high = source.expand.bounds(codes)
    if low >= lowest and low > -math.inf and high < math.inf:  # False for NaN
        return high
    values = source.expand(codes)
    bad = ~(values.isfinite() & (values >= lowest))
    light, texel, channel = (int(i) for i in bad.nonzero()[0])
    place = f"texel {texel}"
    if source.columns:
        place = f"row {texel // source.columns}, column {texel % source.columns}"
    value = float(values[light, texel, channel])
    option = (
        "if they are noise, give data.negative as clip or keep (--set, or FitConfig), or "
        "negative= of load_btf and BTF.from_values"
        if math.isfinite(value)
        else "mend or replace those values before saving"
    )
    raise DataError(
        f"{source.where} holds {value} at [view {view}, light {light}, {place}, channel "
        f"{channel}]; expected finite values that are not negative; {option}."
    )


def transpose_into(target: np.ndarray, pictures: np.ndarray) -> None:
    """Writes codes `[L, T, B]` to `target [T, L, B]`.

    It works in blocks that fit in the cache of a core, as rows of a target in a cache file are far
    apart, and moves all B elements of a pixel at a time.
    """
    pixel = f"V{pictures.shape[-1] * pictures.itemsize}"
    source, rows = pictures.view(pixel)[..., 0], target.view(pixel)[..., 0]
    for block in slices(pictures.shape[1], TRANSPOSED_TEXELS):
        rows[block] = source[:, block].T
