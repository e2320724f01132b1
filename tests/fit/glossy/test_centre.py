"""Unresolved lobes stand where samples meet them, as high as there."""

from __future__ import annotations

from dataclasses import replace

import torch

from spmm_torch.fit.glossy.centre import centred
from spmm_torch.lobes.batch import LobeBatch
from tests.fit.glossy.test_peaks import GRID, WIDTH, lobe

NARROW = 0.2 * WIDTH


def tilted(own: LobeBatch, slope: float) -> LobeBatch:
    """The lobe about a normal of that slope."""
    normal = torch.nn.functional.normalize(torch.tensor([[slope, 0.0, 1.0]]), dim=1)
    return replace(own, normal=normal)


def test_a_peak_between_the_samples_is_moved_to_the_sample_that_meets_its_tail() -> None:
    own, weight = tilted(lobe(NARROW, 0.5), 3.0 * NARROW), torch.full((1, 3), 1e6)
    found, weights = centred(own, weight, GRID, WIDTH)
    assert torch.allclose(found.normal, torch.tensor([[0.0, 0.0, 1.0]]), atol=1e-4)
    before, after = 1e6 * GRID.eval(own)[0], weights[0, 0] * GRID.eval(found)[0]
    assert torch.isclose(after[before.argmax()], before.max(), rtol=1e-4)
    # The peak that no sample had seen is gone: a tail at 3 widths is e^-9 of it.
    assert float(weights[0, 0]) < 1e-3 * 1e6


def test_a_lobe_that_the_samples_resolve_stays() -> None:
    own, weight = tilted(lobe(1.5 * WIDTH, 0.5), 0.1), torch.ones(1, 3)
    found, weights = centred(own, weight, GRID, WIDTH)
    assert torch.equal(found.normal, own.normal)
    assert torch.equal(weights, weight)


def test_a_lobe_without_weight_stays() -> None:
    own, weight = tilted(lobe(NARROW, 0.5), 3.0 * NARROW), torch.zeros(1, 3)
    found, _ = centred(own, weight, GRID, WIDTH)
    assert torch.equal(found.normal, own.normal)
