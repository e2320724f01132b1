"""Errors of compressed values as they are: slopes, units, and a search that never raises them."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch
from torch import Tensor

from spmm_torch import BTF, FitConfig
from spmm_torch.fit.glossy.objective import Objective
from spmm_torch.fit.search.bank import build_bank
from spmm_torch.fit.search.exact import ExactErrors
from spmm_torch.fit.search.joint import CorrectiveSearch
from spmm_torch.fit.search.mixtures import Mixtures
from spmm_torch.fit.weighting import compression
from spmm_torch.geometry.directions import ring_directions
from spmm_torch.lobes.batch import Feasible, encode
from spmm_torch.lobes.grid import DirectionGrid
from tests.planted.btfs import texel_btf

CPU = torch.device("cpu")
DIRECTIONS = ring_directions(((0.0, 1), (30.0, 6), (60.0, 10)))
MODELS = ("lambertian", "blinn_phong", "ward")
CONFIG = FitConfig.from_dict({"search": {"max_lobes": 3, "exchanges": 4, "final_steps": 6}})


def texels() -> Tensor:
    """Values `[2, D, 3]` of highlights over noisy bodies."""
    grid = DirectionGrid.build(DIRECTIONS, DIRECTIONS, CPU)
    bank = build_bank(grid, MODELS, 6, Feasible.build(0.1))
    generator = torch.Generator().manual_seed(0)
    few = grid.eval(bank.lobes[::7])[:6]
    body = 0.02 * torch.rand(2, 3, grid.pair_count, generator=generator)
    return (torch.rand(2, 3, 6, generator=generator) @ few + body).transpose(1, 2)


def exact_errors(btf: BTF, error: str) -> tuple[DirectionGrid, ExactErrors]:
    """Errors of all texels, and the grid that is scaled by their weights."""
    found = compression(btf, Objective(error), CPU)
    assert found is not None
    weights = found.weights(btf)
    assert weights.pair is not None
    grid = DirectionGrid.build(btf.light, btf.view, CPU, weights.scale(CPU))
    values = btf.signals(slice(0, btf.texel_count), CPU)
    return grid, ExactErrors.of(grid, found, values, weights.pair, None, 0.0)


def search(btf: BTF, error: str) -> CorrectiveSearch:
    """A search judged by the errors of an objective."""
    grid, exact = exact_errors(btf, error)
    feasible = Feasible.build(0.25 * grid.spacing)
    bank = build_bank(grid, MODELS, 20, feasible)
    signals = grid.scaled(exact.values)
    return CorrectiveSearch(
        grid, bank, feasible, CONFIG.search, signals, bank.lobes[:0], exact=exact
    )


@pytest.mark.parametrize("error", ["cube-root", "balanced", "log"])
def test_what_is_wanted_of_a_lobe_is_the_slope_of_the_error(error: str) -> None:
    grid, exact = exact_errors(texel_btf(texels(), DIRECTIONS), error)
    lobes = build_bank(grid, MODELS, 6, Feasible.build(0.1)).lobes[::5][:2]
    weights = torch.full((2, 2, 3), 0.3, requires_grad=True)
    shape = lobes.model.expand(2, 2), encode(lobes).expand(2, 2, -1)
    present = torch.ones(2, 2, dtype=torch.bool)
    mixtures = Mixtures(*shape, present, weights, torch.zeros(2))
    rows = torch.arange(2)
    loss = exact.loss(mixtures, rows, 1).sum()
    (slope,) = torch.autograd.grad(loss, weights)
    found = exact.downward(mixtures, rows) @ grid.eval(lobes).T  # [2, C, M]
    assert torch.allclose(-2.0 * found.transpose(1, 2), slope, rtol=1e-3, atol=1e-4)


@pytest.mark.parametrize("error", ["cube-root", "balanced"])
def test_no_change_raises_the_error_that_counts(
    error: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    finder, steps, put = search(texel_btf(texels(), DIRECTIONS), error), [], Mixtures.put

    def watched(self: Mixtures, rows: Tensor, other: Mixtures) -> None:
        before = self.loss[rows].clone()
        put(self, rows, other)
        steps.append(len(rows))
        assert finder.exact is not None
        found = finder.exact.loss(self.take(rows), rows, 8)
        assert torch.allclose(found, self.loss[rows], rtol=1e-3)
        assert (self.loss[rows] <= before).all()

    monkeypatch.setattr(Mixtures, "put", watched)
    finder.run(lambda count: None)
    assert sum(steps) > 6


def test_unrelated_materials_count_in_units_of_their_own() -> None:
    values = texels()[:1]
    alone = texel_btf(values, DIRECTIONS)
    both = replace(
        texel_btf(torch.cat((values, 1000.0 * values)), DIRECTIONS), names=("dim", "bright")
    )
    (first, own), (second, exact) = (exact_errors(btf, "balanced") for btf in (alone, both))
    assert first.scale is not None and second.scale is not None
    assert torch.allclose(first.scale, second.scale, rtol=1e-4)
    relative = exact.energy / own.energy
    assert torch.allclose(relative[0], relative[1], rtol=1e-4)
