"""What a reader gives to a `BTF` besides its header."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import torch
from torch import Tensor

from ..errors import DataError
from ..runtime.memory import slices
from .codes import Codes, Expansion, Index

Progress = Callable[[int, int], None]  # (views done, views in all)


class Store(Protocol):
    """Linear values, however they are kept."""

    is_hdr: bool

    def texels(self, index: Index, device: torch.device | str) -> Tensor:
        """Linear values `[n, D, C]` float32 of some texels, on a device."""
        ...

    def signals(self, index: Index, device: torch.device | str) -> Tensor:
        """The same channels first, `[n, C, D]`, contiguous."""
        ...

    def pairs(self, start: int, stop: int) -> Tensor:
        """Linear values `[T, stop - start, C]` float32 of consecutive pairs, on the CPU."""
        ...


@dataclass(frozen=True)
class CodeStore:
    """Values kept as codes."""

    codes: Codes
    expand: Expansion
    is_hdr: bool

    def texels(self, index: Index, device: torch.device | str = "cpu") -> Tensor:
        return self.expand(self.codes.rows(index).to(device))  # codes travel, not floats

    def signals(self, index: Index, device: torch.device | str = "cpu") -> Tensor:
        codes = self.codes.rows(index).to(device)
        if self.expand.elementwise:  # codes are smaller than values
            return self.expand(codes.transpose(1, 2).contiguous())
        return self.expand(codes).transpose(1, 2).contiguous()

    def pairs(self, start: int, stop: int) -> Tensor:
        return self.expand(self.codes.columns(start, stop))


@dataclass(frozen=True)
class CosineStore:
    """Another store's values, multiplied by the cosine of the light.

    Attributes:
        values: the other store.
        cosine: of the light of each pair, `[D]`.
    """

    values: Store
    cosine: Tensor

    @property
    def is_hdr(self) -> bool:
        """Whether values may exceed 1."""
        return self.values.is_hdr

    def texels(self, index: Index, device: torch.device | str = "cpu") -> Tensor:
        return self.values.texels(index, device) * self.cosine[:, None].to(device)

    def signals(self, index: Index, device: torch.device | str = "cpu") -> Tensor:
        return self.values.signals(index, device) * self.cosine.to(device)

    def pairs(self, start: int, stop: int) -> Tensor:
        return self.values.pairs(start, stop) * self.cosine[start:stop, None]


@dataclass(frozen=True)
class Loading:
    """How a BTF is to be decoded.

    Attributes:
        progress: told (views done, views in all).
        memory: bytes that decoded values may take; what needs more goes to the cache. None: any
            number.
        cache: folder for decoded values. If it is given they go there whatever their size; None:
            the user's own cache folder, if need be.
        negative: of values below zero: "refuse", "clip" to zero, or "keep" them.
    """

    progress: Progress | None = None
    memory: int | None = None
    cache: Path | None = None
    negative: str = "refuse"


@dataclass(frozen=True)
class Part:
    """The part of a BTF that is to be decoded; None: all of them.

    Attributes:
        texels: indices `[T']` into the texels of the source.
        views, lights: indices into its views and lights.
    """

    texels: Tensor | None = None
    views: Tensor | None = None
    lights: Tensor | None = None

    @property
    def is_whole(self) -> bool:
        """Whether nothing is left out."""
        return self.texels is None and self.views is None and self.lights is None


WHOLE = Part()


def check_not_black(maximum: float, where: str) -> None:
    """Refuse a BTF that reflects nothing: no model, and no error in decibels, exists for it."""
    if maximum <= 0.0:
        raise DataError(
            f"{where} is all black; expected at least one value above zero; "
            f"check how the pictures were exposed or converted."
        )


def float_chunks(store: Store, texel_count: int, chunk: int) -> Iterator[Tensor]:
    """All values of a store in blocks of `chunk` texels, `[n, D, C]` each."""
    for block in slices(texel_count, chunk):
        yield store.texels(block, "cpu")
