"""A trial of the errors by which glossy texels may be fit whose peaks the directions resolve.

Plain squared errors see the brightest peaks alone. Relative to their view, all peaks count, and
what lies between samples is nearer. But a lobe for the body of a clear coat takes little away from
either, so that it may be refused, and the colour of the body is lost: errors balanced with those of
cube roots hold it. Which way loses less, the samples tell: in values and in cube roots, dB for dB.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from ...config.fit import SearchConfig
from ...lobes.batch import Feasible
from ...lobes.grid import DirectionGrid
from ...runtime.progress import Advance
from ..search.bank import build_bank
from ..search.joint import CorrectiveSearch
from .compression import BALANCED, L2, Compression, own_units
from .views import BY_VIEW

# Texels of the trial, at most, and normals of its candidates, as for few samples.
TEXELS, NORMALS = 8, 120
# Searches of a texel at most, one for each of the errors.
STEPS = 3
# Relative squared errors of values and of cube roots that nobody sees: 30 and 20 dB.
UNSEEN_VALUES, UNSEEN_ROOTS = 1e-3, 1e-2


def best_error(grid: DirectionGrid, values: Tensor, search: SearchConfig) -> str:
    """The name of the errors that suit most texels.

    Args:
        grid: the measured pairs.
        values: of some texels, `[n, C, D]`.
        search: settings of the search.
    """
    some = values[:: -(-len(values) // TEXELS)]
    return Counter(best_errors(grid, some, search, lambda steps: None)).most_common(1)[0][0]


def best_errors(
    grid: DirectionGrid, values: Tensor, search: SearchConfig, advance: Advance
) -> list[str]:
    """The names of the errors that suit each of n texels: l2, by-view or balanced.

    Squared errors stay where they are right in cube roots, too, and errors relative to their view
    are worse in both. These are taken where they are right in cube roots, or the product of both
    errors is lower than by balanced ones. What nobody sees is no gain.

    Args:
        grid: the measured pairs.
        values: of the texels, `[n, C, D]`.
        search: settings of the search.
        advance: receives `STEPS` units a texel.
    """
    values = values / own_units(values)
    plain = _errors(grid, values, search, L2)
    advance(len(values))
    by_view = _errors(grid, values, search, BY_VIEW)
    advance(len(values))
    stays = (plain.roots <= UNSEEN_ROOTS) & plain.is_below(by_view)
    suits = by_view.roots <= UNSEEN_ROOTS
    if not bool((stays | suits).all()):
        suits |= by_view.product() <= _errors(grid, values, search, BALANCED).product()
    advance(len(values))
    pairs = zip(stays.tolist(), suits.tolist(), strict=True)
    return [L2 if plain_one else BY_VIEW if view else BALANCED for plain_one, view in pairs]


@dataclass(frozen=True)
class _Found:
    """Relative squared errors of n texels, `[n]`, in values and in cube roots."""

    values: Tensor
    roots: Tensor

    def is_below(self, other: _Found) -> Tensor:
        """Where both errors are at most those of another way, `[n]`."""
        return (self.values <= other.values) & (self.roots <= other.roots)

    def product(self) -> Tensor:
        """The product `[n]` of both errors as far as anybody sees them."""
        return self.values.clamp(min=UNSEEN_VALUES) * self.roots.clamp(min=UNSEEN_ROOTS)


def _errors(grid: DirectionGrid, values: Tensor, search: SearchConfig, error: str) -> _Found:
    """What lobes that are sought by errors of a name leave.

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
    return _Found(_relative(values.double(), found.double()), _relative(*roots))


def _relative(wanted: Tensor, found: Tensor) -> Tensor:
    """Squared errors `[n]` of values `[n, C, D]` relative to their energy."""
    energy = wanted.square().sum((1, 2))
    return (wanted - found).square().sum((1, 2)) / energy.clamp(min=torch.finfo(energy.dtype).tiny)
