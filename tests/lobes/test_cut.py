"""Where lobes end: below the lowest measured light, and at their own horizon."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
import torch
from torch import Tensor

from spmm_torch.brdf import MODEL_NAMES
from spmm_torch.geometry.directions import direction_from_angles, frame_from_normal, ring_directions
from spmm_torch.geometry.grazing import lowest_cosine
from spmm_torch.lobes.batch import LobeBatch
from spmm_torch.lobes.cut import view_step
from tests.planted.directions import random_directions
from tests.planted.lobes import random_lobes

RINGS = ring_directions()
LOWEST = lowest_cosine(RINGS)


def tilted_lobes(count: int = 20 * len(MODEL_NAMES)) -> LobeBatch:
    generator = torch.Generator().manual_seed(1)
    names = [MODEL_NAMES[index % len(MODEL_NAMES)] for index in range(count)]
    return replace(random_lobes(names, generator), horizon=0.0)


def grazing_lights(z: float) -> Tensor:
    phi = torch.linspace(0.0, 6.2, 40)
    return direction_from_angles(torch.arccos(torch.full_like(phi, z)), phi)


def test_measured_pairs_are_unchanged_to_the_bit() -> None:
    lobes = tilted_lobes()
    faded = replace(lobes, lowest=LOWEST)
    assert torch.equal(faded.eval_grid(RINGS, RINGS), lobes.eval_grid(RINGS, RINGS))


def test_lobes_end_at_the_horizon_of_the_texel() -> None:
    """Half of these lobes lean towards the light, and would be bright there."""
    lobes = tilted_lobes()
    wo = random_directions(30, 2, max_theta=1.3, dtype=torch.float32)
    hard = lobes.eval_grid(grazing_lights(1e-5), wo)
    faded = replace(lobes, lowest=LOWEST).eval_grid(grazing_lights(1e-5), wo)
    assert float(hard.mean()) > 1e-2
    assert (faded <= hard).all()
    brightest = lobes.eval_grid(RINGS, RINGS).amax(1, keepdim=True)
    assert (faded <= 1e-2 * brightest.clamp(min=0.1)).all()
    nearer = replace(lobes, lowest=LOWEST).eval_grid(grazing_lights(1e-4), wo)
    assert float(faded.sum()) < 0.3 * float(nearer.sum())


def test_upright_lobes_never_change() -> None:
    lobes = tilted_lobes()
    upright = replace(lobes, normal=torch.tensor([0.0, 0.0, 1.0]).expand_as(lobes.normal))
    wi = random_directions(50, 3, max_theta=1.57, dtype=torch.float32)
    found = replace(upright, lowest=LOWEST).eval_grid(wi, RINGS)
    assert torch.equal(found, upright.eval_grid(wi, RINGS))


def test_lobes_that_end_alike_stay_so() -> None:
    lobes = replace(tilted_lobes(9), horizon=0.1, lowest=LOWEST)
    for other in (lobes[2:5], lobes[torch.tensor([1, 1])], lobes.to("cpu"), lobes.detach()):
        assert (other.horizon, other.lowest) == (0.1, LOWEST)
    both = LobeBatch.cat((lobes, lobes))
    assert (len(both), both.horizon, both.lowest) == (18, 0.1, LOWEST)


@pytest.mark.parametrize("lowest", [0.0, LOWEST])
def test_gradients_are_finite(lowest: float) -> None:
    lobes = replace(tilted_lobes(), lowest=lowest)
    wi = grazing_lights(1e-4).requires_grad_()
    lobes.eval_grid(wi, RINGS).sum().backward()
    assert wi.grad is not None
    assert wi.grad.isfinite().all()


def near_own_horizon(lobes: LobeBatch, turn: float) -> Tensor:
    """Views `[J, 64, 3]` within a degree of the horizon of each lobe, moved by `turn` degrees."""
    generator = torch.Generator().manual_seed(4)
    height = torch.deg2rad(torch.rand(len(lobes), 64, generator=generator) * 2.0 - 1.0 + turn)
    along = frame_from_normal(lobes.normal, 6.2 * torch.rand(len(lobes), generator=generator))
    flat, normal = along[:, None, 0], along[:, None, 2]
    return torch.cos(height)[..., None] * flat + torch.sin(height)[..., None] * normal


@pytest.mark.parametrize(("horizon", "smooth"), [(0.0, False), (5.0, True), (10.0, True)])
def test_a_small_turn_of_the_view_changes_little(horizon: float, smooth: bool) -> None:
    """0.019 degrees, about a hundredth of a pixel of a sphere, jumped by the whole value."""
    lobes = replace(tilted_lobes(), horizon=math.radians(horizon))
    wi = torch.tensor([0.0, 0.0, 1.0])[None, None]
    before, after = (lobes.eval(wi, near_own_horizon(lobes, turn)) for turn in (0.0, 0.019))
    brightest = lobes.eval_grid(RINGS, RINGS).amax(1, keepdim=True)
    jump = ((after - before).abs() / brightest).nan_to_num().max()
    assert (float(jump) < 0.02) == smooth


@pytest.mark.parametrize("horizon", [2.0, 15.0])
def test_the_step_has_a_continuous_derivative(horizon: float) -> None:
    width = math.radians(horizon)
    x = torch.linspace(-0.5, 1.5, 4001, dtype=torch.float64) * math.sin(width)
    x.requires_grad_()
    step = view_step(x, width)
    (slope,) = torch.autograd.grad(step.sum(), x)
    assert float(step.detach().min()) == 0.0
    assert float(step.detach().max()) == 1.0
    assert float((slope[1:] - slope[:-1]).abs().max()) * math.sin(width) < 0.004
    beyond = x.detach() >= math.sin(width)
    assert bool((step.detach()[beyond] == 1.0).all())


def test_values_beyond_the_step_are_the_paper_s_to_the_bit() -> None:
    lobes = tilted_lobes()
    found = replace(lobes, horizon=math.radians(5.0)).eval_grid(RINGS, RINGS)
    hard = lobes.eval_grid(RINGS, RINGS)
    cosine = (lobes.normal @ RINGS.T)[:, :, None].expand(-1, -1, len(RINGS)).flatten(1)
    high = cosine > math.sin(math.radians(5.0))
    assert torch.equal(found[high], hard[high])
    assert (found <= hard).all()
