"""Stores: the values of a BTF, which its reader opens."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np
import torch
from torch import Tensor

from ..errors import DataError
from ..runtime.memory import slices
from .codes import Codes, Index
from .expansion import Expansion

Progress = Callable[[int, int], None]  # called with (units done, number of units)


class Store(Protocol):
    """Linear values of a BTF, however they are stored."""

    @property
    def is_hdr(self) -> bool:
        """Whether a value may exceed 1."""
        ...

    @property
    def level(self) -> float:
        """The highest value, or that of some texels where finding it would read all."""
        ...

    def texels(self, index: Index, device: torch.device | str) -> Tensor:
        """Values `[n, D, C]` float32 of some texels, on a device."""
        ...

    def signals(self, index: Index, device: torch.device | str) -> Tensor:
        """Values `[n, C, D]` float32 of some texels, contiguous, on a device."""
        ...

    def pairs(self, start: int, stop: int) -> Tensor:
        """Values `[T, stop - start, C]` float32 of consecutive direction pairs, on the CPU."""
        ...

    def strips(
        self, texel: Tensor, view: Tensor, lights: int, device: torch.device | str
    ) -> Tensor:
        """Values `[N, L, C]` float32 of texels `[N]`, each under all L lights of its view `[N]`."""
        ...


def channels_first(values: Tensor) -> Tensor:
    """Values or codes `[n, D, B]` as `[n, B, D]`, contiguous.

    On a CPU by NumPy, which takes a third of the time that PyTorch takes for few channels.
    """
    if values.device.type != "cpu":
        return values.transpose(1, 2).contiguous()
    return torch.from_numpy(np.ascontiguousarray(values.numpy().transpose(0, 2, 1)))


@dataclass(frozen=True)
class CodeStore:
    """Values that are stored as codes.

    Attributes:
        codes: codes `[T, D, B]`.
        expand: expansion of the codes to values.
        level: the highest value.
    """

    codes: Codes
    expand: Expansion
    level: float

    @property
    def is_hdr(self) -> bool:
        """Whether a value exceeds 1."""
        return self.level > 1.0

    def texels(self, index: Index, device: torch.device | str = "cpu") -> Tensor:
        """Values `[n, D, C]`; see `Store.texels`."""
        return self.expand(
            self.codes.rows(index).to(device)
        )  # codes are smaller to send than floats

    def signals(self, index: Index, device: torch.device | str = "cpu") -> Tensor:
        """Values `[n, C, D]`; see `Store.signals`."""
        codes = self.codes.rows(index).to(device)
        if self.expand.elementwise:  # codes are smaller than values
            return self.expand(channels_first(codes))
        return channels_first(self.expand(codes))

    def pairs(self, start: int, stop: int) -> Tensor:
        """Values `[T, stop - start, C]`; see `Store.pairs`."""
        return self.expand(self.codes.columns(start, stop))

    def strips(
        self, texel: Tensor, view: Tensor, lights: int, device: torch.device | str = "cpu"
    ) -> Tensor:
        """Values `[N, L, C]`; see `Store.strips`."""
        return self.expand(self.codes.strips(texel, view, lights).to(device))


@dataclass(frozen=True)
class ScaledStore:
    """The values of another store, multiplied by a factor of the light.

    Attributes:
        values: the other store.
        factor: factor of each light, such as its cosine, `[L, 1]`, or `[L, C]` by channel.
        views: number of views, V.
    """

    values: Store
    factor: Tensor
    views: int

    @property
    def is_hdr(self) -> bool:
        """Whether a value may exceed 1."""
        return self.values.is_hdr or float(self.factor.max()) > 1.0

    @property
    def level(self) -> float:
        """A bound on the highest value; see `Store.level`."""
        return self.values.level * float(self.factor.max())

    def texels(self, index: Index, device: torch.device | str = "cpu") -> Tensor:
        """Values `[n, D, C]`; see `Store.texels`."""
        return self.values.texels(index, device) * self._of_pairs().to(device)

    def signals(self, index: Index, device: torch.device | str = "cpu") -> Tensor:
        """Values `[n, C, D]`; see `Store.signals`."""
        return self.values.signals(index, device) * self._of_pairs().T.to(device)

    def pairs(self, start: int, stop: int) -> Tensor:
        """Values `[T, stop - start, C]`; see `Store.pairs`."""
        return self.values.pairs(start, stop) * self._of_pairs()[start:stop]

    def strips(
        self, texel: Tensor, view: Tensor, lights: int, device: torch.device | str = "cpu"
    ) -> Tensor:
        """Values `[N, L, C]`; see `Store.strips`."""
        return self.values.strips(texel, view, lights, device) * self.factor.to(device)

    def _of_pairs(self) -> Tensor:
        """The factor of each direction pair, `[D, 1]` or `[D, C]`."""
        return self.factor.repeat(self.views, 1)


@dataclass(frozen=True)
class Loading:
    """Options of the decoding of a BTF.

    Attributes:
        progress: called with (views done, number of views).
        memory: bytes that decoded values may take in memory; more go to the cache. None: any
            number.
        cache: folder for decoded values of any size; None: the user's cache folder, and only for
            values that exceed `memory`.
        negative: treatment of values below zero: "refuse", "clip" to zero, or "keep".
    """

    progress: Progress | None = None
    memory: int | None = None
    cache: Path | None = None
    negative: str = "refuse"


@dataclass(frozen=True)
class Part:
    """The part of a source that a BTF holds.

    Attributes:
        texels: indices `[T']` of texels of the source; None: all.
        views, lights: indices `[V']`, `[L']` of directions of the source; None: all.
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
    """Refuses a BTF without reflection, for which there is no model and no error in decibels.

    Raises:
        DataError: the maximum of the values is not positive.
    """
    if maximum <= 0.0:
        raise DataError(
            f"{where} is all black; expected at least one value above zero; "
            f"check how the pictures were exposed or converted."
        )


def float_chunks(store: Store, texel_count: int, chunk: int) -> Iterator[Tensor]:
    """All values of a store, `[n, D, C]` for each block of `chunk` texels."""
    for block in slices(texel_count, chunk):
        yield store.texels(block, "cpu")
