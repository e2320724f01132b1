"""What of a residual its neighbours foresee."""

from __future__ import annotations

import torch

from spmm_torch.fit.residual.trust import trust
from spmm_torch.geometry.directions import ring_directions

DIRECTIONS = ring_directions()


def smooth() -> torch.Tensor:
    """A residual that varies slowly, `[V, 1, L, 3]`."""
    slope = 1.0 + 0.3 * DIRECTIONS[:, 0]
    return (slope[:, None] * slope[None, :])[:, None, :, None].expand(-1, 1, -1, 3)


def test_a_smooth_residual_is_kept() -> None:
    assert float(trust(smooth(), DIRECTIONS, DIRECTIONS).min()) > 0.9


def test_a_spike_is_dropped_and_its_surroundings_stay() -> None:
    functions = smooth().clone()
    functions[40, 0, 30] = 100.0
    kept = trust(functions, DIRECTIONS, DIRECTIONS)
    assert float(kept[40, 30]) < 0.02
    assert float(kept.median()) > 0.9


def test_what_changes_its_sign_from_pair_to_pair_is_dropped() -> None:
    functions = torch.randn(81, 1, 81, 3, generator=torch.Generator().manual_seed(0))
    assert float(trust(functions, DIRECTIONS, DIRECTIONS).mean()) < 0.1
