"""Peaks narrower than the directions: planted mirrors of known reflectance."""

from __future__ import annotations

import pytest
import torch

from spmm_torch.brdf import MAX_PARAMETERS, MODEL_NAMES
from spmm_torch.fit.glossy.energy import held_to_energy, white_sky
from spmm_torch.fit.glossy.peaks import DIELECTRIC, METAL, unresolved
from spmm_torch.geometry.directions import ring_directions
from spmm_torch.lobes.batch import Feasible, LobeBatch, encode
from spmm_torch.lobes.grid import DirectionGrid

GRID = DirectionGrid.build(ring_directions(), ring_directions(), torch.device("cpu"))
WIDTH = 0.25 * GRID.spacing


def lobe(width: float, f0: float) -> LobeBatch:
    """An upright Cook-Torrance lobe."""
    kappa = torch.zeros(1, MAX_PARAMETERS)
    kappa[0, :2] = torch.tensor([width, f0])
    model = torch.tensor([MODEL_NAMES.index("cook_torrance")])
    return LobeBatch(model, kappa, torch.tensor([[0.0, 0.0, 1.0]]), torch.zeros(1))


def samples(own: LobeBatch, body: float = 0.001) -> torch.Tensor:
    """Values `[1, 3, D]` of a lobe over a dim body."""
    return (GRID.eval(own) + body)[None].expand(1, 3, -1)


@pytest.mark.parametrize("width", [0.008, 0.012, 0.02])
@pytest.mark.parametrize(("f0", "metal"), [(DIELECTRIC, False), (METAL, True)])
def test_the_width_of_an_unresolved_peak_follows_from_its_height(
    width: float, f0: float, metal: bool
) -> None:
    found = unresolved(GRID, samples(lobe(width, f0)), WIDTH)
    assert found is not None
    assert found.metal == metal
    assert found.width == pytest.approx(width, rel=0.05)


def test_a_peak_that_the_directions_resolve_keeps_its_width() -> None:
    assert unresolved(GRID, samples(lobe(1.5 * WIDTH, METAL)), WIDTH) is None


def test_noise_below_zero_has_no_peak() -> None:
    noise = torch.randn(8, 3, GRID.pair_count, generator=torch.Generator().manual_seed(0)) - 5.0
    assert unresolved(GRID, noise, WIDTH) is None


def test_widths_that_no_sample_tells_are_left_out() -> None:
    feasible = Feasible.build(WIDTH).or_as_narrow_as(0.01)
    for width, nearest in ((0.005, 0.01), (0.02, 0.01), (0.05, WIDTH), (0.2, 0.2)):
        own = lobe(width, 0.5)
        moved = GRID.decode(own.model, feasible.project(own.model, encode(own)))
        assert float(moved.kappa[0, 0]) == pytest.approx(nearest, rel=1e-3)


def test_the_white_sky_reflectance_is_that_of_samples() -> None:
    own, theta = lobe(0.3, 0.6), torch.tensor([0.0, 0.8, 1.2])
    generator = torch.Generator().manual_seed(0)
    u = torch.rand(1 << 18, 2, generator=generator)
    z = u[:, 0]
    radius = (1.0 - z * z).sqrt()
    turn = 2.0 * torch.pi * u[:, 1]
    wi = torch.stack((radius * turn.cos(), radius * turn.sin(), z), dim=-1)
    view = torch.stack((theta.sin(), torch.zeros(3), theta.cos()), dim=-1)
    truth = 2.0 * torch.pi * own.eval(wi[None, None], view[None, :, None]).mean(2)
    assert torch.allclose(white_sky(own, theta), truth, rtol=0.03)


def test_lobes_that_reflect_too_much_shrink_at_the_same_height() -> None:
    own = lobe(0.02, 1.0)
    peak = unresolved(GRID, samples(lobe(0.01, METAL)), WIDTH)
    assert peak is not None
    weight = torch.full((1, 1, 3), 4.0)
    held = held_to_energy(own, weight, peak, WIDTH)
    steep = torch.tensor([0.0, 0.5])
    before = 4.0 * white_sky(own, steep)
    # The same height takes a weight that is less by the square of the width.
    share = float(held.kappa[0, 0] / own.kappa[0, 0]) ** 2
    after = 4.0 * share * white_sky(held, steep)
    assert float(before.max()) > 3.0
    assert float(after.max()) < 1.1
