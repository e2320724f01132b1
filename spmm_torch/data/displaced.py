"""A BTF whose pictures are shifted texel by texel, so that every view shows the same surface point.

A view wo shows the surface point over x at p = x - h(x) s, with s = wo_xy / wo_z. The values of a
texel are those of the pixels nearest to these places: one read each, four times as fast as
bilinear lookups, and nothing is blurred.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import torch
from torch import Tensor

from ..geometry.directions import continued
from ..geometry.relief import HeightField, texel_centres
from .codes import Index, positions
from .store import Store, channels_first


@dataclass(frozen=True)
class DisplacedStore:
    """The values of another store, read where each view shows the point of the surface.

    Attributes:
        values: the other store.
        field: heights of the surface.
        view: measured views, `[V, 3]`.
        lights: number of lights, L.
        drift: registration of each picture, `[V, 2]` in units of u and v; None: 0.
    """

    values: Store
    field: HeightField
    view: Tensor
    lights: int
    drift: Tensor | None = None

    @property
    def is_hdr(self) -> bool:
        """Whether a value of the other store may exceed 1."""
        return self.values.is_hdr

    @property
    def level(self) -> float:
        """A bound on the highest value; see `Store.level`."""
        return self.values.level

    def texels(self, index: Index, device: torch.device | str = "cpu") -> Tensor:
        """Values `[n, D, C]`; see `Store.texels`."""
        pixel = self._pixels(self._rows(index))  # [n, V]
        views = torch.arange(len(self.view)).expand(pixel.shape).flatten()
        values = self.values.strips(pixel.flatten(), views, self.lights, device)
        return values.view(len(pixel), -1, values.shape[-1])

    def signals(self, index: Index, device: torch.device | str = "cpu") -> Tensor:
        """Values `[n, C, D]`; see `Store.signals`."""
        return channels_first(self.texels(index, device))

    def pairs(self, start: int, stop: int) -> Tensor:
        """Values `[T, stop - start, C]`; see `Store.pairs`."""
        return self.texels(None)[:, start:stop]

    def strips(
        self, texel: Tensor, view: Tensor, lights: int, device: torch.device | str
    ) -> Tensor:
        """Values `[N, L, C]`; see `Store.strips`."""
        pixel = self._pixels(texel)[torch.arange(len(texel)), view]
        return self.values.strips(pixel, view, lights, device)

    def _rows(self, index: Index) -> Tensor:
        """Texels `[n]` of an index."""
        if index is None or isinstance(index, slice):
            return torch.arange(self.field.height.numel())[slice(None) if index is None else index]
        return positions(index)

    @cached_property
    def _centres(self) -> Tensor:
        """uv `[T, 2]` of the centres of all texels."""
        height, width = self.field.height.shape
        return texel_centres(height, width, self.view)

    def _pixels(self, rows: Tensor) -> Tensor:
        """The pixels `[n, V]` that show texels `rows [n]`."""
        height, width = self.field.height.shape
        centre = self._centres[rows, None]  # [n, 1, 2]
        at = self.field.place(centre, self.view)  # [n, V, 2]
        if self.drift is not None:
            at = at - self.drift
        column, row = torch.floor(at[..., 0] * width), torch.floor((1.0 - at[..., 1]) * height)
        rule = self.field.rule
        return continued(row.long(), height, rule) * width + continued(column.long(), width, rule)
