"""The unit of a BTF's values: very small or large ones are scaled before they are computed with.

Squares of float32 values leave its range from 1e-19 downwards and 1e19 upwards. A power of two
scales without rounding, so that a fit finds the same lobes in any unit.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor

from ..errors import DataError
from .btf import BTF
from .codes import Index
from .store import Part, Store

# Highest values of a BTF that is left as it is: those of reflectance and of mirrors.
ORDINARY = (2.0**-10, 2.0**20)
# Highest value over the 99.9th percentile from which on it is no reflection.
HOT = 2.0**20


@dataclass(frozen=True)
class UnitStore:
    """The values of another store, times a factor.

    Attributes:
        values: the other store.
        factor: a power of two.
    """

    values: Store
    factor: float

    @property
    def is_hdr(self) -> bool:
        """Whether a value of the other store may exceed 1."""
        return self.values.is_hdr

    @property
    def level(self) -> float:
        """About the highest value; see `Store.level`."""
        return self.values.level * self.factor

    def texels(self, index: Index, device: torch.device | str = "cpu") -> Tensor:
        """Values `[n, D, C]`; see `Store.texels`."""
        return self.values.texels(index, device) * self.factor

    def signals(self, index: Index, device: torch.device | str = "cpu") -> Tensor:
        """Values `[n, C, D]`; see `Store.signals`."""
        return self.values.signals(index, device) * self.factor

    def pairs(self, start: int, stop: int) -> Tensor:
        """Values `[T, stop - start, C]`; see `Store.pairs`."""
        return self.values.pairs(start, stop) * self.factor

    def planes(self, start: int, stop: int) -> Tensor:
        """Values `[C, T, stop - start]`; see `Store.planes`."""
        return self.values.planes(start, stop) * self.factor

    def strips(
        self, texel: Tensor, view: Tensor, lights: int, device: torch.device | str = "cpu"
    ) -> Tensor:
        """Values `[N, L, C]`; see `Store.strips`."""
        return self.values.strips(texel, view, lights, device) * self.factor


def unit_of(btf: BTF) -> float:
    """The power of two that brings the highest value of a BTF near 1; 1 for ordinary values.

    Raises:
        DataError: a few values are so high that no fit sees anything else.
    """
    level = btf.level()
    low, high = ORDINARY
    if low <= level <= high:
        return 1.0
    if level > high:
        _refuse_hot(btf, level)
    return 2.0 ** -math.frexp(level)[1]


def scaled(btf: BTF, factor: float) -> BTF:
    """A BTF whose values are `factor` times those of another, which it reads; 1: itself."""
    if factor == 1.0:
        return btf

    def open_store(_part: Part, _loading: object) -> Store:
        return UnitStore(btf.store(), factor)

    return btf.over(open_store)


def _refuse_hot(btf: BTF, level: float) -> None:
    """Raises a DataError that names the highest value where it stands far above all others."""
    ordinary = btf.peak()
    if level <= HOT * ordinary:
        return
    view, light, row, column, value = highest_value(btf)
    raise DataError(
        f"{btf.path or btf.name} holds {value:g} at view {view}, light {light}, row {row}, column "
        f"{column}, where 99.9 % of its values are at most {ordinary:g}; expected values of one "
        f"scale; mend that hot pixel."
    )


def highest_value(btf: BTF) -> tuple[int, int, int, int, float]:
    """The highest value of a BTF, and its view, light, row and column."""
    best = (0, 0, 0, 0, -math.inf)
    for view in range(len(btf.view)):
        pictures = btf.pictures(view)  # [L, H, W, C]
        value = float(pictures.max())
        if value > best[-1]:
            place = torch.nonzero(pictures == value)[0].tolist()
            best = (view, *place[:3], value)
    return best
