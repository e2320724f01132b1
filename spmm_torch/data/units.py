"""The unit of a BTF's values: very small or large ones are scaled before they are computed with.

Squares of float32 values leave its range from 1e-19 downwards and 1e19 upwards. A power of two
scales without rounding, so that a fit finds the same lobes in any unit.
"""

from __future__ import annotations

import math

import torch

from ..errors import DataError
from .btf import BTF
from .scattered_btf import ScatteredBTF
from .store import Part, ScaledStore, Store

# Highest values of a BTF that is left as it is: those of reflectance and of mirrors.
ORDINARY = (2.0**-10, 2.0**20)
# Highest value over the 99.9th percentile from which on it is no reflection.
HOT = 2.0**20
# Highest values that any unit has: weights and errors beside them still are numbers of float32.
KNOWN = (1e-30, 1e30)


def unit_of(btf: BTF) -> float:
    """The power of two that brings the highest value of a BTF near 1; 1 for ordinary values.

    Raises:
        DataError: a few values are so high that no fit sees anything else, or all are beyond what
            float32 computes with.
    """
    level = btf.level()
    low, high = ORDINARY
    if low <= level <= high:
        return 1.0
    if level > high:
        _refuse_hot(btf, level)
    if not KNOWN[0] <= level <= KNOWN[1]:
        raise DataError(
            f"{btf.path or btf.name} has {level:g} as highest value; expected one from "
            f"{KNOWN[0]:g} to {KNOWN[1]:g}; multiply all values by one factor."
        )
    return 2.0 ** -math.frexp(level)[1]


def scaled(btf: BTF, factor: float) -> BTF:
    """A BTF whose values are `factor` times those of another, which it reads; 1: itself."""
    if factor == 1.0:
        return btf

    def open_store(_part: Part, _loading: object) -> Store:
        return ScaledStore(btf.store(), torch.full((len(btf.light), 1), factor), len(btf.view))

    return btf.over(open_store)


def _refuse_hot(btf: BTF, level: float) -> None:
    """Raises a DataError that names the highest value where it stands far above all others."""
    ordinary = btf.peak()
    if level <= HOT * ordinary:
        return
    if isinstance(btf, ScatteredBTF):
        place, value = btf.brightest()
    else:
        view, light, row, column, value = highest_value(btf)
        place = f"view {view}, light {light}, row {row}, column {column}"
    raise DataError(
        f"{btf.path or btf.name} holds {value:g} at {place}, where 99.9 % of its values are at "
        f"most {ordinary:g}; expected values of one scale; mend that hot pixel."
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
