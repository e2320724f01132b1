"""A trial of squared errors: whether lobes that fit the values of glossy texels look right, too.

A lobe for the body of a clear coat takes little away from a squared error that mirror peaks rule,
so it may be refused, and the colour of the body is lost. Cube roots tell.
"""

from __future__ import annotations

from torch import Tensor

from ...config.fit import SearchConfig
from ...lobes.batch import Feasible
from ...lobes.grid import DirectionGrid
from ..search.bank import build_bank
from ..search.joint import CorrectiveSearch

# Texels of the trial, at most, and normals of its candidates, as for few samples.
TEXELS, NORMALS = 8, 120
# Relative squared error of cube roots that nobody sees: 20 dB.
UNSEEN = 0.01


def looks_right(grid: DirectionGrid, values: Tensor, search: SearchConfig) -> bool:
    """Whether lobes by squared errors are right in cube roots for most texels.

    Args:
        grid: the measured pairs.
        values: of some texels, `[n, C, D]`.
        search: settings of the search.
    """
    some = values[:: -(-len(values) // TEXELS)]
    return bool(look_right(grid, some, search).double().mean() >= 0.5)


def look_right(grid: DirectionGrid, values: Tensor, search: SearchConfig) -> Tensor:
    """For which texels, `[n]` bool, lobes by squared errors are right in cube roots.

    Args:
        grid: the measured pairs.
        values: of the texels, `[n, C, D]`.
        search: settings of the search.
    """
    feasible = Feasible.build(search.min_width * grid.spacing).to(grid.light)
    bank = build_bank(grid, search.models, NORMALS, feasible)
    finder = CorrectiveSearch(grid, bank, feasible, search, values, bank.lobes[:0])
    found = finder.run(lambda steps: None).values(grid)  # [n, C, D]
    wanted, found = (part.double().clamp(min=0.0).pow(1.0 / 3.0) for part in (values, found))
    error = (wanted - found).square().sum((1, 2))
    return error <= UNSEEN * wanted.square().sum((1, 2))
