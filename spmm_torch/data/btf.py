"""`BTF`: what every reader returns. Lazy, and texel-major once decoded."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
import torch
from torch import Tensor

from ..geometry import direction_pairs
from .percentile import percentile
from .store import Progress, Store, float_chunks, store_from_views

DISPLAY_GAMMA = 2.2
# Fraction of all values that the peak of an HDR BTF does not exceed.
PEAK_FRACTION = 0.999
# Values that are expanded at once where all texels are passed over: 64 MB of float32.
CHUNK_VALUES = 1 << 24


@dataclass(eq=False)
class BTF:
    """Linear, cosine-weighted reflectance of T = H x W texels under D = V x L direction pairs.

    Making one only reads names and headers; pictures are decoded at the first `texels`, or by
    `load`. Memory then stays at the source's own bit depth: 1 byte a value for 8-bit pictures.

    Args:
        name: short name of the material.
        path: where it was read from, as given; empty if made in memory.
        height, width: of the pictures; texel t = row * width + column, row 0 at the top.
        view, light: unit vectors `[V, 3]`, `[L, 3]` float32, pointing away from the surface.
        bytes_per_value: bit depth of the source: 1 (8 bit), 2 (float16) or 4 (float32).
        open_store: decodes everything; called once, with the progress function.
        hdr: whether values may exceed 1; None if only the decoded values can tell.
    """

    name: str
    path: str
    height: int
    width: int
    view: Tensor = field(repr=False)
    light: Tensor = field(repr=False)
    bytes_per_value: int
    open_store: Callable[[Progress | None], Store] = field(repr=False)
    hdr: bool | None = False
    channels: int = 3
    _store: Store | None = field(default=None, init=False, repr=False)
    _peak: float | None = field(default=None, init=False, repr=False)

    @classmethod
    def from_values(
        cls, values: Tensor | np.ndarray, view: Tensor, light: Tensor, *, name: str = "values"
    ) -> BTF:
        """A BTF of linear cosine-weighted `values [V, L, H, W, 3]`, float16 or float32.

        HDR if a value exceeds 1, as for NPZ files.

        Raises:
            DataError: whatever the NPZ reader would refuse.
        """
        # The NPZ reader owns the rules of this layout and needs BTF itself.
        from .npz import check_layout

        array = values.detach().cpu().numpy() if isinstance(values, Tensor) else values
        where = f"the array of BTF {name!r}"
        view, light = check_layout(array.shape, array.dtype, view, light, where)
        dtype = torch.float16 if array.dtype.itemsize == 2 else torch.float32
        store = store_from_views(
            (np.ascontiguousarray(pictures) for pictures in array), array.shape[:4], dtype, where
        )
        height, width = array.shape[2:4]
        itemsize = array.dtype.itemsize
        return cls(name, "", height, width, view, light, itemsize, lambda _: store, hdr=None)

    @property
    def texel_count(self) -> int:
        """T, the number of texels."""
        return self.height * self.width

    @property
    def pair_count(self) -> int:
        """D, the number of direction pairs."""
        return len(self.view) * len(self.light)

    @property
    def raw_bytes(self) -> int:
        """Size of all values at the source's own bit depth, uncompressed."""
        return self.texel_count * self.pair_count * self.channels * self.bytes_per_value

    @property
    def is_hdr(self) -> bool:
        """Whether values may exceed 1; decodes where the header does not tell (NPZ)."""
        return self._loaded().is_hdr if self.hdr is None else self.hdr

    def pairs(self) -> tuple[Tensor, Tensor]:
        """Light and view `(wi [D, 3], wo [D, 3])` of each direction pair d = view * L + light."""
        return direction_pairs(self.light, self.view)

    def load(self, progress: Progress | None = None) -> BTF:
        """Decode now, if not yet done; `progress(done, total)` is told after each view.

        Raises:
            DataError: a picture cannot be decoded, or a value is not valid.
        """
        self._loaded(progress)
        return self

    def texels(
        self, index: Tensor | slice | None = None, device: torch.device | str = "cpu"
    ) -> Tensor:
        """Values `[n, D, C]` float32 of the given texels, of all without an index.

        Any order, repeats and boolean masks are allowed. Read-only: the result of a BTF that
        keeps float32 may share its memory. 8-bit codes are expanded on `device` itself.
        """
        return self._loaded().texels(index, device)

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
            store = self._loaded()
            self._peak = percentile(
                lambda: float_chunks(store, self.texel_count, chunk), PEAK_FRACTION
            )
        return self._peak

    def _loaded(self, progress: Progress | None = None) -> Store:
        if self._store is None:
            self._store = self.open_store(progress)
        return self._store
