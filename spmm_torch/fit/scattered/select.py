"""Sparse weights of the texels of one list: products with all lobes, by blocks of pairs."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import torch
from torch import Tensor

from ...data.error_weights import Weights
from ...data.pair_lists import PairedBTF, PairList
from ...lobes.batch import LobeBatch
from ...lobes.grid import DirectionGrid
from ...metrics import Totals
from ...runtime.memory import slices
from ..problem import Problem
from ..select.products import Products, correlations, squared_norms
from ..select.target import Target
from ..select.texels import Fit, select, squared_errors
from .listed import ListFit, limited
from .together import fit_together, is_short
from .weights import list_weights

# Values of all lobes at a block of pairs, texels that choose at once: some 10 MB each.
BLOCK_VALUES, BLOCK_TEXELS = 1 << 22, 1 << 10


def fit_lists(parts: Sequence[PairList], lobes: LobeBatch, problem: Problem) -> Iterator[ListFit]:
    """The fits of the texels of all lists, some at a time.

    Args:
        parts: the whole lists.
        lobes: J lobes to choose from.
        problem: of a search, for settings, objective and device.
    """
    short = [part for part in parts if is_short(part, problem.config.select)]
    if len(short) > 1:
        yield from fit_together(short, lobes, problem)
    else:
        short = []
    done = set(map(id, short))
    for part in parts:
        if id(part) not in done:
            yield from fit_list(part, lobes, problem)


def fit_list(part: PairList, lobes: LobeBatch, problem: Problem) -> Iterator[ListFit]:
    """The fits of the texels of a list, some at a time.

    Args:
        part: the whole list.
        lobes: J lobes to choose from.
        problem: of a search, for settings, objective and device.
    """
    btf, device = PairedBTF.of(part), problem.device
    weights = list_weights(btf, problem.objective, device)
    scale = weights.scale(device)
    grid = DirectionGrid.of_pairs(part.wi, part.wo, device, scale)
    gram = _gram(grid, lobes)
    norm = gram.diagonal().sqrt()
    seen = torch.nonzero(norm > 0.0).squeeze(1)
    unit = norm[seen]
    gram = (gram[seen][:, seen] / (unit[:, None] * unit)).float()
    config = limited(problem.config.select, len(part.wi))
    for texels in slices(len(part.texels), BLOCK_TEXELS):
        correlation, energy = _products(grid, lobes[seen], btf, weights, texels)
        none = gram.new_zeros(0)
        known = (correlation / unit[:, None]).float()
        products = Products(gram, known, energy, none, none, none, len(energy), len(energy))
        target = Target(products.correlation, products.energy)
        fit = select(products, target, config, problem.config.stagewise)
        yield _listed(part.texels[texels], fit, products, seen, unit)


def _blocks(grid: DirectionGrid, lobes: LobeBatch) -> Iterator[tuple[slice, Tensor]]:
    """Blocks of pairs, and the values `[J, b]` of all lobes there, scaled."""
    for block in slices(grid.pair_count, max(1, BLOCK_VALUES // max(1, len(lobes)))):
        yield block, grid.part(block).eval(lobes)


def _gram(grid: DirectionGrid, lobes: LobeBatch) -> Tensor:
    """Products of lobes with each other, `[J, J]` float64."""
    total = torch.zeros(len(lobes), len(lobes), dtype=torch.float64, device=grid.light.device)
    for _, rho in _blocks(grid, lobes):
        total += rho @ rho.T
    return total


def _products(
    grid: DirectionGrid, lobes: LobeBatch, btf: PairedBTF, weights: Weights, texels: slice
) -> tuple[Tensor, Tensor]:
    """Products of lobes with values `[n, J, C]`, and squared norms of these `[n, C]`, float64."""
    signals = weights.signals(btf, texels, grid.light.device)  # [n, C, D]
    shape = (len(signals), len(lobes), signals.shape[1])
    total = torch.zeros(shape, dtype=torch.float64, device=signals.device)
    for block, rho in _blocks(grid, lobes):
        total += correlations(rho, signals[..., block])
    return total, squared_norms(signals)


def _listed(texels: Tensor, fit: Fit, products: Products, seen: Tensor, unit: Tensor) -> ListFit:
    """A fit by the indices of all lobes, with weights of lobes that are not scaled to unit norm."""
    energy = float(products.energy.sum())
    error = float(squared_errors(products, fit).sum())
    slot = fit.index.clamp(min=0)
    index = torch.where(fit.index >= 0, seen[slot], -1)
    weights = fit.weights / unit[slot].to(fit.weights)[..., None]
    return ListFit(
        texels,
        index.cpu(),
        weights.cpu(),
        Totals(energy, error, error, float("nan")),
        fit.solvers.to("cpu"),
    )
