"""Lobes found by the space that signals span: planted ones are found exactly, noise gives none."""

from __future__ import annotations

import pytest
import torch
from torch import Tensor

from spmm_torch.brdf import MODEL_NAMES
from spmm_torch.config.fit import SearchConfig
from spmm_torch.fit.search.bank import Bank, build_bank
from spmm_torch.fit.search.music import music_lobes, signal_subspace
from spmm_torch.geometry.directions import ring_directions
from spmm_torch.lobes.batch import Feasible, LobeBatch
from spmm_torch.lobes.grid import DirectionGrid
from tests.planted.lobes import HORIZON, random_lobes

DIRECTIONS = ring_directions(((0.0, 1), (25.0, 6), (50.0, 10), (70.0, 12)))
GRID = DirectionGrid.build(DIRECTIONS, DIRECTIONS, torch.device("cpu"), horizon=HORIZON)
FEASIBLE = Feasible.build(0.125 * GRID.spacing)
LOBES = 6


@pytest.fixture(scope="module")
def bank() -> Bank:
    return build_bank(GRID, SearchConfig().models, 24, FEASIBLE)


def planted_lobes(seed: int) -> LobeBatch:
    """One lobe of each of the first models but Lambertian."""
    generator = torch.Generator().manual_seed(seed)
    return random_lobes(MODEL_NAMES[1 : 1 + LOBES], generator, tilt=1.0)


def unit(values: Tensor) -> Tensor:
    return values / values.norm(dim=1, keepdim=True)


def mixtures(seed: int, noise: float = 0.0) -> tuple[Tensor, Tensor]:
    """Signals `[N, D]` of random weights, and the lobes `[J, D]` that made them."""
    generator = torch.Generator().manual_seed(100 + seed)
    atoms = unit(GRID.eval(planted_lobes(seed)))
    signals = torch.rand(40, LOBES, generator=generator) @ atoms
    return signals + noise * torch.randn(signals.shape, generator=generator), atoms


@pytest.mark.parametrize("seed", range(2))
def test_planted_lobes_are_found_exactly(bank: Bank, seed: int) -> None:
    signals, atoms = mixtures(seed)
    assert len(signal_subspace(signals)) == LOBES
    found = unit(GRID.eval(music_lobes(signals, GRID, bank, FEASIBLE)))
    likeness = found @ atoms.T
    # Every lobe that is found is a planted one, and most of them are found.
    assert float(likeness.amax(1).min()) > 0.9999
    assert int((likeness.amax(0) > 0.9999).sum()) >= LOBES - 1


def test_space_holds_the_signals() -> None:
    signals, _ = mixtures(0)
    space = signal_subspace(signals)
    assert torch.allclose(space @ space.T, torch.eye(LOBES), atol=1e-4)
    assert torch.allclose((signals @ space.T) @ space, signals, atol=1e-4)


def test_half_precision_signals_still_span_few_dimensions() -> None:
    signals, _ = mixtures(1)
    assert len(signal_subspace(signals.half().float())) == LOBES


@pytest.mark.parametrize("noise", [0.003, 0.1])
def test_noisy_signals_span_everything(bank: Bank, noise: float) -> None:
    signals, _ = mixtures(2, noise)
    assert len(signal_subspace(signals)) == 0
    assert len(music_lobes(signals, GRID, bank, FEASIBLE)) == 0


def test_few_or_black_signals_span_nothing() -> None:
    signals, _ = mixtures(0)
    assert len(signal_subspace(signals[:LOBES])) == 0
    assert len(signal_subspace(torch.zeros(8, signals.shape[1]))) == 0
    assert len(signal_subspace(signals[:0])) == 0


@pytest.mark.parametrize("seed", [1, 2])  # at these the fixed bank alone does not find it
def test_lobes_narrower_than_the_grid_are_found_at_their_peaks(bank: Bank, seed: int) -> None:
    lobes = planted_lobes(seed)
    kappa = lobes.kappa.clone()
    kappa[2, :2] = 0.06  # Ward's slopes
    lobes = LobeBatch(lobes.model, kappa, lobes.normal, lobes.angle)
    atoms = unit(GRID.eval(lobes))
    generator = torch.Generator().manual_seed(5)
    signals = torch.rand(40, LOBES, generator=generator) @ atoms
    found = unit(GRID.eval(music_lobes(signals, GRID, bank, FEASIBLE)))
    assert float((found @ atoms[2]).max()) > 0.9999
