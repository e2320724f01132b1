"""The `BTF` that every reader returns: lazy, and texel-major once decoded."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import cast

import torch
from numpy.typing import ArrayLike
from torch import Tensor

from ..geometry.relief import HeightField
from ..runtime.device import plain_torch
from .arrays import array_hash, check_layout, numpy_values, opener_in_memory
from .btf_header import BTFHeader
from .cache import entry_key, source_content
from .displaced import DisplacedStore
from .kept import chosen, kept_gaps, kept_names
from .options import ReadOptions
from .percentile import percentile
from .store import Loading, Part, Progress, ScaledStore, Store, float_chunks

# Fraction of all values that the peak of an HDR BTF does not exceed.
PEAK_FRACTION = 0.999
# Values of a chunk where all texels are passed over: 64 MB of float32.
CHUNK_VALUES = 1 << 24
# Texels that are hashed at once, where a BTF is known by its values alone.
CHUNK_TEXELS = 1 << 8


@dataclass(eq=False)
class BTF(BTFHeader):
    """Linear, cosine-weighted reflectance of T = H x W texels under D = V x L direction pairs.

    A new BTF has read only names and headers; see `BTFHeader` for what they tell, and for the
    arguments. Pictures are decoded by `load`, or by the first call of `texels`. Values are then
    kept at the bit depth of the source, such as 1 byte a value.
    """

    _store: Store | None = field(default=None, init=False, repr=False)
    _peak: float | None = field(default=None, init=False, repr=False)

    @classmethod
    @plain_torch()
    def from_values(
        cls,
        values: ArrayLike,
        view: ArrayLike,
        light: ArrayLike,
        *,
        name: str = "values",
        negative: str = "refuse",
    ) -> BTF:
        """A BTF of linear cosine-weighted `values [V, L, H, W, 3]`, float16 or float32.

        The BTF is HDR if a value exceeds 1.

        Args:
            values: linear cosine-weighted values: a tensor, an array, or nested lists (float32).
            view, light: unit vectors `[V, 3]`, `[L, 3]`, pointing away from the surface.
            name: short name of the material.
            negative: treatment of values below zero, as in `ReadOptions`.

        Raises:
            ConfigError: `negative` is not known.
            DataError: a shape or type is wrong, or a value or direction is not valid.
        """
        where = f"the array of BTF {name!r}"
        array = numpy_values(values, where)
        view, light = check_layout(array.shape, array.dtype, view, light, where)
        _, _, height, width, _ = array.shape
        opener, itemsize = opener_in_memory(array, where), array.dtype.itemsize
        btf = cls(name, "", height, width, view, light, itemsize, opener, hdr=None)
        btf.content = partial(array_hash, array)
        options = ReadOptions(negative=negative)
        return replace(btf, negative=options.negative, read_as=options.settings()).load()

    def restricted(
        self,
        texels: Tensor | None = None,
        size: tuple[int, int] | None = None,
        *,
        views: Tensor | None = None,
        lights: Tensor | None = None,
    ) -> BTF:
        """A part of this BTF, which decodes and keeps no more than that part.

        Args:
            texels: indices `[T']` of the texels that form a picture of `size`; None: all.
            size: (height, width) of that picture.
            views, lights: indices `[V']`, `[L']` of the directions in their new order; None: all.

        Raises:
            DataError: all pairs of the directions are missing.
        """
        height, width = size or (self.height, self.width)
        return replace(
            self,
            height=height,
            width=width,
            view=self.view if views is None else self.view[views],
            light=self.light if lights is None else self.light[lights],
            missing=kept_gaps(self.missing, views, lights),
            names=kept_names(self.names, texels),
            part=Part(
                chosen(self.part.texels, texels),
                chosen(self.part.views, views),
                chosen(self.part.lights, lights),
            ),
        )

    def aligned(self, field: HeightField, drift: Tensor | None = None) -> BTF:
        """This BTF as it would be if every view showed the same surface point in each texel.

        It reads the decoded values of this BTF.

        Args:
            field: heights of the surface.
            drift: registration of each picture, `[V, 2]` in units of u and v; None: 0.
        """

        def open_store(_part: Part, _loading: Loading) -> Store:
            return DisplacedStore(self.store(), field, self.view, len(self.light), drift)

        return self.over(open_store)

    def over(self, open_store: Callable[[Part, Loading], Store]) -> BTF:
        """The BTF whose store reads the decoded values of this one, as `open_store` says."""
        return replace(self, open_store=open_store, cosine_missing=False)

    def identity(self) -> str:
        """The hash of the content of the source and of the part taken, in hexadecimal.

        Neither the name nor the place of the source counts. All bytes of a source other than a zip
        are read for it.

        Raises:
            DataError: the source cannot be read any more.
        """
        part = (self.part.texels, self.part.views, self.part.lights)
        kept = [None if index is None else index.tolist() for index in part]
        directions = self.view.tolist(), self.light.tolist()
        return entry_key((self._content(), kept, directions))

    def _content(self) -> object:
        """Checksums or hashes of the source, or of the values where it is known by no file."""
        if self.content is not None:
            return self.content()
        if self.path:
            return source_content(Path(self.path))
        chunks = float_chunks(self.store(), self.texel_count, CHUNK_TEXELS)
        return [array_hash(chunk.numpy()) for chunk in chunks]

    @property
    def is_hdr(self) -> bool:
        """Whether values may exceed 1; decodes them where the header does not tell."""
        return self.store().is_hdr if self.hdr is None else self.hdr

    def level(self) -> float:
        """The highest value; if values are streamed, that of some texels."""
        return self.store().level

    def store(self) -> Store:
        """The decoded values."""
        if self._store is None:
            self.load()
        return cast(Store, self._store)

    @plain_torch()
    def load(
        self,
        progress: Progress | None = None,
        *,
        memory: int | None = None,
        cache: Path | None = None,
    ) -> BTF:
        """Decodes the values unless this has been done; returns the BTF itself.

        Args:
            progress: called with (views done, number of views) after each view.
            memory: bytes that decoded values may take; a BTF that needs more is kept on disk.
                None: any number.
            cache: folder for decoded values, which later runs reuse; None: the user's cache
                folder, and only for a BTF that exceeds `memory`.

        Raises:
            DataError: a picture cannot be decoded, or a value is not valid.
            OutputError: the cache cannot be written.
        """
        if self._store is None:
            store = self.open_store(self.part, Loading(progress, memory, cache, self.negative))
            if self.cosine_missing:
                cosine = self.light[:, 2:].clamp(min=0.0)  # [L, 1]
                store = ScaledStore(store, cosine, len(self.view))
            self._store = store
        return self

    def texels(
        self, index: Tensor | slice | None = None, device: torch.device | str = "cpu"
    ) -> Tensor:
        """Values `[n, D, C]` float32 of some texels, on a device; not to be written to.

        The result may share the memory of the BTF.

        Args:
            index: indices `[n]` in any order, also repeated, a mask `[T]` bool, or a slice; None:
                all texels.
            device: device of the result, on which 8-bit codes are expanded.

        Raises:
            DataError: a picture cannot be decoded, or a value is not valid.
            OutputError: the decoded values cannot be read or written on disk.
        """
        return self.store().texels(index, device)

    def signals(
        self, index: Tensor | slice | None = None, device: torch.device | str = "cpu"
    ) -> Tensor:
        """The values of `texels` with channels first, `[n, C, D]`, contiguous.

        Raises:
            DataError, OutputError: as for `texels`.
        """
        return self.store().signals(index, device)

    def samples(self, texel: int) -> tuple[Tensor, Tensor, Tensor]:
        """Lights `[N, 3]`, views `[N, 3]` and values `[N, C]` of what was measured of a texel."""
        kept = slice(None) if self.measured is None else self.measured
        wi, wo = self.pairs()
        return wi[kept], wo[kept], self.texels(torch.tensor([texel]))[0][kept]

    def picture(self, view: int, light: int) -> Tensor:
        """The linear picture `[H, W, C]` of one direction pair."""
        pair = view * len(self.light) + light
        values = self.store().pairs(pair, pair + 1)  # [T, 1, C]
        return values.view(self.height, self.width, self.channels)

    def pictures(self, view: int) -> Tensor:
        """The linear pictures `[L, H, W, C]` of one view under each light."""
        light_count = len(self.light)
        first = view * light_count
        values = self.store().pairs(first, first + light_count)  # [T, L, C]
        return values.unflatten(0, (self.height, self.width)).permute(2, 0, 1, 3)

    def views(self, start: int, stop: int) -> Tensor:
        """Linear values `[T, n, L, C]` of n consecutive views, on the CPU."""
        lights = len(self.light)
        values = self.store().pairs(start * lights, stop * lights)
        return values.unflatten(1, (stop - start, lights))

    def peak(self) -> float:
        """The peak of the PSNR: 1.0 for LDR, the exact 99.9th percentile of values for HDR."""
        if not self.is_hdr:
            return 1.0
        if self._peak is None:
            chunk = max(CHUNK_VALUES // (self.pair_count * self.channels), 1)
            pairs = self.pair_count if self.measured is None else int(self.measured.sum())
            count = self.texel_count * pairs * self.channels
            self._peak = percentile(self._measured_chunks(chunk), count, PEAK_FRACTION)
        return self._peak

    def _measured_chunks(self, size: int) -> Iterator[Tensor]:
        """Values `[n, D', C]` of the measured pairs, `size` texels at a time."""
        measured = self.measured
        for chunk in float_chunks(self.store(), self.texel_count, size):
            yield chunk if measured is None else chunk[:, measured]
