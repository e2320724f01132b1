"""What is known of a BTF before a value is decoded."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field

from torch import Tensor

from ..config.fit import DataConfig
from ..geometry.directions import direction_pairs
from .store import WHOLE, Loading, Part, Store


@dataclass(eq=False)
class BTFHeader:
    """Names, sizes and directions of T = H x W texels under D = V x L direction pairs.

    Args:
        name: short name of the material.
        path: path of the source as given; empty for values in memory.
        height, width: size of the pictures; texel t = row * width + column, row 0 at the top.
        view, light: unit vectors `[V, 3]`, `[L, 3]` float32, pointing away from the surface.
        bytes_per_value: bytes of a value in the source: 1 or 2 (8 or 16 bits), 4/3 (RGBE), 2 or 4
            (float).
        open_store: function that decodes a part of the source; called once.
        hdr: whether values may exceed 1; None if only the decoded values tell.
        channels: number of channels, C.
        part: part of the source that this BTF holds.
        streamed: whether values are computed at every access and never kept.
        cosine_missing: whether values are yet to be multiplied by the cosine of the light.
        negative: treatment of values below zero: "refuse", "clip" to zero, or "keep".
        missing: direction pairs without values (zeros stand for them), `[V, L]` bool; None: none.
        notes: lines about the input that whoever reads it ought to see.
        names: of the materials of texels that are no neighbours, T of them; None: a texture.
        content: function that gives checksums or hashes of the source, whatever its name; None:
            the bytes of all files at `path` tell.
        read_as: the settings that it was read by.
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
    notes: tuple[str, ...] = field(default=(), repr=False)
    names: tuple[str, ...] | None = field(default=None, repr=False)
    content: Callable[[], object] | None = field(default=None, repr=False)
    read_as: DataConfig = field(default=DataConfig(), repr=False)

    @property
    def texel_count(self) -> int:
        """The number of texels, T."""
        return self.height * self.width

    @property
    def pair_count(self) -> int:
        """The number of direction pairs, D."""
        return math.prod(self.pair_shape)

    @property
    def pair_shape(self) -> tuple[int, int]:
        """(V, L), as direction pairs are ordered."""
        return len(self.view), len(self.light)

    @property
    def measured(self) -> Tensor | None:
        """Whether each direction pair has values, `[D]` bool; None if all have."""
        return None if self.missing is None else ~self.missing.flatten()

    @property
    def measured_count(self) -> int:
        """The number of direction pairs that have values."""
        return self.pair_count if self.missing is None else int((~self.missing).sum())

    @property
    def value_count(self) -> int:
        """The number of measured values, over all texels, pairs and channels."""
        return self.texel_count * self.measured_count * self.channels

    @property
    def raw_bytes(self) -> int:
        """Bytes of all values at the bit depth of the source, uncompressed."""
        return round(self.value_count * self.bytes_per_value)

    def pairs(self) -> tuple[Tensor, Tensor]:
        """Directions `(wi [D, 3], wo [D, 3])` of the direction pairs d = view * L + light."""
        return direction_pairs(self.light, self.view)
