"""A trial of both ways to fit glossy texels whose peaks the directions resolve.

Errors relative to their view are nearer to the peaks, and between samples, too; but a lobe for the
body of a clear coat takes little away from them, so that it may be refused, and the colour of the
body is lost. Errors that are balanced with those of cube roots hold the body. Which way loses less,
the samples tell: what one gains in values, and the other in cube roots, in dB.
"""

from __future__ import annotations

from dataclasses import replace

import torch
from torch import Tensor

from ...config.fit import SearchConfig
from ...lobes.batch import Feasible
from ...lobes.grid import DirectionGrid
from ..search.bank import build_bank
from ..search.joint import CorrectiveSearch
from .compression import Compression, own_units
from .views import BY_VIEW

# Texels of the trial, at most, and normals of its candidates, as for few samples.
TEXELS, NORMALS = 8, 120
# Relative squared errors of values and of cube roots that nobody sees: 30 and 20 dB.
UNSEEN_VALUES, UNSEEN_ROOTS = 1e-3, 1e-2


def suits_views(grid: DirectionGrid, values: Tensor, search: SearchConfig) -> bool:
    """Whether errors relative to their view suit most texels.

    Args:
        grid: the measured pairs.
        values: of some texels, `[n, C, D]`.
        search: settings of the search.
    """
    some = values[:: -(-len(values) // TEXELS)]
    return bool(suit_views(grid, some, search).double().mean() >= 0.5)


def suit_views(grid: DirectionGrid, values: Tensor, search: SearchConfig) -> Tensor:
    """Which texels, `[n]` bool, errors relative to their view suit better than balanced ones.

    That is where they are right in cube roots, or the product of the errors of values and of cube
    roots is lower. What nobody sees is no gain.

    Args:
        grid: the measured pairs.
        values: of the texels, `[n, C, D]`.
        search: settings of the search.
    """
    values = values / own_units(values)
    plain, roots = _errors(grid, values, search, BY_VIEW)
    right = roots <= UNSEEN_ROOTS
    if bool(right.all()):
        return right
    others = _errors(grid, values, search, "balanced")
    return right | (_product(plain, roots) <= _product(*others))


def _errors(
    grid: DirectionGrid, values: Tensor, search: SearchConfig, error: str
) -> tuple[Tensor, Tensor]:
    """Relative squared errors `[n]` of lobes, in values and in cube roots.

    Args:
        grid: the measured pairs.
        values: of the texels, `[n, C, D]`.
        search: settings of the search.
        error: by which lobes are sought.
    """
    size = values.mean((0, 1), dtype=torch.float64).cpu()
    every = torch.ones_like(size, dtype=torch.bool)
    weight = Compression.of(error, size, every, grid.view.shape[1]).pair_weights()
    grid = replace(grid, scale=(weight / weight.mean()).sqrt().to(values))
    feasible = Feasible.build(search.min_width * grid.spacing).to(grid.light)
    bank = build_bank(grid, search.models, NORMALS, feasible)
    finder = CorrectiveSearch(grid, bank, feasible, search, grid.scaled(values), bank.lobes[:0])
    found = finder.run(lambda steps: None).values(grid.unscaled)  # [n, C, D]
    roots = (part.double().clamp(min=0.0).pow(1.0 / 3.0) for part in (values, found))
    return _relative(values.double(), found.double()), _relative(*roots)


def _product(plain: Tensor, roots: Tensor) -> Tensor:
    """The product `[n]` of both errors as far as anybody sees them."""
    return plain.clamp(min=UNSEEN_VALUES) * roots.clamp(min=UNSEEN_ROOTS)


def _relative(wanted: Tensor, found: Tensor) -> Tensor:
    """Squared errors `[n]` of values `[n, C, D]` relative to their energy."""
    energy = wanted.square().sum((1, 2))
    return (wanted - found).square().sum((1, 2)) / energy.clamp(min=torch.finfo(energy.dtype).tiny)
