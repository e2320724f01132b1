"""`BTF`: what every reader returns. Lazy, and texel-major once decoded."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import cast

import numpy as np
import torch
from torch import Tensor

from ..errors import DataError
from ..geometry.directions import direction_pairs
from .arrays import check_layout, numpy_values, opener_in_memory
from .options import ReadOptions
from .percentile import percentile
from .store import WHOLE, CosineStore, Loading, Part, Progress, Store, float_chunks

# Fraction of all values that the peak of an HDR BTF does not exceed.
PEAK_FRACTION = 0.999
# Values that are expanded at once where all texels are passed over: 64 MB of float32.
CHUNK_VALUES = 1 << 24


@dataclass(eq=False)
class BTF:
    """Linear, cosine-weighted reflectance of T = H x W texels under D = V x L direction pairs.

    Making one only reads names and headers; pictures are decoded at the first `texels`, or by
    `load`. Values then stay at the source's own bit depth: 1 byte a value for 8-bit pictures.

    Args:
        name: short name of the material.
        path: where it was read from, as given; empty if made in memory.
        height, width: of the pictures; texel t = row * width + column, row 0 at the top.
        view, light: unit vectors `[V, 3]`, `[L, 3]` float32, pointing away from the surface.
        bytes_per_value: of the source: 1 (8 bit), 4/3 (RGBE), 2 (float16) or 4 (float32).
        open_store: decodes a part of it; called once.
        hdr: whether values may exceed 1; None if only the decoded values can tell.
        part: what of the source this is.
        streamed: whether values are computed anew whenever they are asked for, and never kept.
        cosine_missing: whether values are to be multiplied by the cosine of the light.
        negative: of values below zero: "refuse", "clip" to zero, or "keep" them.
        missing: which pairs have no values but zeros, `[V, L]` bool; None if all have some.
    """

    name: str
    path: str
    height: int
    width: int
    view: Tensor = field(repr=False)
    light: Tensor = field(repr=False)
    bytes_per_value: float
    open_store: Callable[[Part, Loading], Store] = field(repr=False)
    hdr: bool | None = False
    channels: int = 3
    part: Part = field(default=WHOLE, repr=False)
    streamed: bool = False
    cosine_missing: bool = False
    negative: str = "refuse"
    missing: Tensor | None = field(default=None, repr=False)
    _store: Store | None = field(default=None, init=False, repr=False)
    _peak: float | None = field(default=None, init=False, repr=False)

    @classmethod
    def from_values(
        cls,
        values: Tensor | np.ndarray,
        view: Tensor,
        light: Tensor,
        *,
        name: str = "values",
        negative: str = "refuse",
    ) -> BTF:
        """A BTF of linear cosine-weighted `values [V, L, H, W, 3]`, float16 or float32.

        HDR if a value exceeds 1, as for NPZ files; `negative` is that of `ReadOptions`.

        Raises:
            DataError: whatever the NPZ reader would refuse.
        """
        # The NPZ reader owns the rules of this layout and needs BTF itself.
        where = f"the array of BTF {name!r}"
        array = numpy_values(values, where)
        view, light = check_layout(array.shape, array.dtype, view, light, where)
        _, _, height, width, _ = array.shape
        opener, itemsize = opener_in_memory(array, where), array.dtype.itemsize
        btf = cls(name, "", height, width, view, light, itemsize, opener, hdr=None)
        return replace(btf, negative=ReadOptions(negative=negative).negative).load()

    def restricted(
        self,
        texels: Tensor | None = None,
        size: tuple[int, int] | None = None,
        *,
        views: Tensor | None = None,
        lights: Tensor | None = None,
    ) -> BTF:
        """A part of this BTF that decodes, and keeps, no more than that part.

        Args:
            texels: indices of the texels that make a picture of `size` (height, width).
            views, lights: indices of the directions that stay, in their new order.
        """
        height, width = size or (self.height, self.width)
        return replace(
            self,
            height=height,
            width=width,
            view=self.view if views is None else self.view[views],
            light=self.light if lights is None else self.light[lights],
            missing=_kept_gaps(self.missing, views, lights),
            part=Part(
                _chosen(self.part.texels, texels),
                _chosen(self.part.views, views),
                _chosen(self.part.lights, lights),
            ),
        )

    @property
    def texel_count(self) -> int:
        """T, the number of texels."""
        return self.height * self.width

    @property
    def pair_count(self) -> int:
        """D, the number of direction pairs."""
        return len(self.view) * len(self.light)

    @property
    def measured(self) -> Tensor | None:
        """Which direction pairs have values, `[D]` bool; None if all have."""
        return None if self.missing is None else ~self.missing.flatten()

    @property
    def measured_count(self) -> int:
        """The number of direction pairs that have values."""
        return self.pair_count if self.missing is None else int((~self.missing).sum())

    @property
    def raw_bytes(self) -> int:
        """Size of all values at the source's own bit depth, uncompressed."""
        values = self.texel_count * self.measured_count * self.channels
        return round(values * self.bytes_per_value)

    @property
    def is_hdr(self) -> bool:
        """Whether values may exceed 1; decodes where the header does not tell (NPZ)."""
        return self._loaded().is_hdr if self.hdr is None else self.hdr

    def pairs(self) -> tuple[Tensor, Tensor]:
        """Light and view `(wi [D, 3], wo [D, 3])` of each direction pair d = view * L + light."""
        return direction_pairs(self.light, self.view)

    def load(
        self,
        progress: Progress | None = None,
        *,
        memory: int | None = None,
        cache: Path | None = None,
    ) -> BTF:
        """Decode now, if not yet done.

        Args:
            progress: told (views done, views in all) after each view.
            memory: bytes that decoded values may take; what needs more is kept on disk. None: any
                number.
            cache: folder for decoded values, reused by later runs; None: the user's own cache
                folder, and only for what exceeds `memory`.

        Raises:
            DataError: a picture cannot be decoded, or a value is not valid.
            OutputError: the cache cannot be written.
        """
        if self._store is None:
            store = self.open_store(self.part, Loading(progress, memory, cache, self.negative))
            if self.cosine_missing:
                cosine = self.light[:, 2].clamp(min=0.0).repeat(len(self.view))  # [D]
                store = CosineStore(store, cosine)
            self._store = store
        return self

    def texels(
        self, index: Tensor | slice | None = None, device: torch.device | str = "cpu"
    ) -> Tensor:
        """Values `[n, D, C]` float32 of the given texels, of all without an index.

        Any order, repeats and boolean masks are allowed. Read-only: the result of a BTF that
        keeps float32 may share its memory. 8-bit codes are expanded on `device` itself.
        """
        return self._loaded().texels(index, device)

    def signals(
        self, index: Tensor | slice | None = None, device: torch.device | str = "cpu"
    ) -> Tensor:
        """The values of `texels`, channels first: `[n, C, D]`, contiguous."""
        return self._loaded().signals(index, device)

    def picture(self, view: int, light: int) -> Tensor:
        """The linear picture `[H, W, C]` of one direction pair."""
        pair = view * len(self.light) + light
        values = self._loaded().pairs(pair, pair + 1)  # [T, 1, C]
        return values.view(self.height, self.width, self.channels)

    def pictures(self, view: int) -> Tensor:
        """The linear pictures `[L, H, W, C]` of one view under each light."""
        light_count = len(self.light)
        first = view * light_count
        values = self._loaded().pairs(first, first + light_count)  # [T, L, C]
        return values.unflatten(0, (self.height, self.width)).permute(2, 0, 1, 3)

    def peak(self) -> float:
        """Reference of the PSNR: 1.0 for LDR, the exact 99.9th percentile of values for HDR."""
        if not self.is_hdr:
            return 1.0
        if self._peak is None:
            chunk = max(CHUNK_VALUES // (self.pair_count * self.channels), 1)
            pairs = self.pair_count if self.measured is None else int(self.measured.sum())
            count = self.texel_count * pairs * self.channels
            self._peak = percentile(self._measured_chunks(chunk), count, PEAK_FRACTION)
        return self._peak

    def _measured_chunks(self, size: int) -> Iterator[Tensor]:
        """All values but those of missing pairs, `size` texels at a time."""
        measured = self.measured
        for chunk in float_chunks(self._loaded(), self.texel_count, size):
            yield chunk if measured is None else chunk[:, measured]

    def _loaded(self) -> Store:
        self.load()
        return cast(Store, self._store)


def _kept_gaps(
    missing: Tensor | None, views: Tensor | None, lights: Tensor | None
) -> Tensor | None:
    """The missing pairs of the directions that stay; None if there are none."""
    if missing is None:
        return None
    kept = missing if views is None else missing[views]
    kept = kept if lights is None else kept[:, lights]
    if bool(kept.all()):
        raise DataError(
            "all pairs of the chosen directions are missing; expected at least one with a picture; "
            "choose others."
        )
    return kept if bool(kept.any()) else None


def _chosen(before: Tensor | None, index: Tensor | None) -> Tensor | None:
    """Indices into the source of those that are chosen from the ones that were chosen before."""
    if before is None or index is None:
        return before if index is None else index
    return before[index]
