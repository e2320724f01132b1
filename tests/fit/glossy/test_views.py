"""Weights by which errors are relative to their view and light: planted peaks, black, missing."""

from __future__ import annotations

import torch

from spmm_torch.fit.glossy.views import LEAST_ENERGY, view_weights

VIEWS, LIGHTS = 4, 5


def test_mirror_peaks_of_all_views_count_alike() -> None:
    peak = torch.tensor([1.0, 3.0, 10.0, 100.0]).double()
    size = torch.diag(peak).flatten()
    weight = view_weights(size, torch.ones_like(size, dtype=torch.bool), VIEWS)
    energy = (weight * size.square()).view(VIEWS, VIEWS).diagonal()
    torch.testing.assert_close(energy, energy.mean().expand(VIEWS))


def test_pairs_that_are_missing_do_not_make_a_view_dark() -> None:
    measured = torch.ones(VIEWS * LIGHTS, dtype=torch.bool)
    measured[: LIGHTS - 1] = False
    even = torch.full(measured.shape, 3.0).double()
    found = view_weights(torch.where(measured, even, 0.0), measured, VIEWS)
    assert float(found.max() / found.min()) < 1.0 + 1e-9


def test_black_views_have_finite_weights() -> None:
    size = torch.ones(VIEWS * LIGHTS).double()
    size[:LIGHTS] = 0.0
    every = torch.ones_like(size, dtype=torch.bool)
    weight = view_weights(size, every, VIEWS).view(VIEWS, LIGHTS)
    assert bool(weight.isfinite().all())
    ratio = float(weight[0, 0] / weight[-1, 0])
    assert 0.99 * LEAST_ENERGY**-0.5 < ratio < 1.01 * LEAST_ENERGY**-0.5
    assert bool((view_weights(0.0 * size, every, VIEWS) == 1.0).all())
