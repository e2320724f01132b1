"""Environments as fixed directions: no noise, and little error."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
import torch
from torch import Tensor

from spmm_torch.render import (
    Camera,
    CosineSampled,
    EnvironmentLight,
    RenderSettings,
    Scene,
    Sphere,
    render,
    turn,
)
from spmm_torch.render.fixed_lights import FixedLights, cells
from spmm_torch.render.material import has_narrow_highlights
from tests.benchmarks.sampling_variance import glossy_model
from tests.planted.directions import random_directions
from tests.planted.materials import Lambertian
from tests.planted.models import DIFFUSE, planted_model

STUDIO = EnvironmentLight.studio()
SCENE = Scene(Sphere(), Camera.orthographic(), (STUDIO,))


def irradiance(direction: Tensor, power: Tensor, normal: Tensor) -> Tensor:
    """RGB on surfaces of `normal [N, 3]`: `[N, 3]`."""
    return (normal @ direction.T).clamp(min=0.0) @ power


@pytest.mark.parametrize(("count", "error"), [(16, 0.06), (64, 0.015)])
def test_cells_light_surfaces_as_the_whole_environment_does(count: int, error: float) -> None:
    light = STUDIO.rotated(turn((0.0, 0.6, 0.8), 1.0))
    normal = random_directions(200, 1, max_theta=math.pi)
    expected = irradiance(*light.points(1 << 20), normal)
    found = irradiance(*cells(light, count), normal)
    assert float((found - expected).norm() / expected.norm()) < error


def test_cells_hold_all_power_of_small_and_large_maps() -> None:
    generator = torch.Generator().manual_seed(0)
    for height, width in ((5, 7), (300, 601)):
        light = EnvironmentLight.build(torch.rand(height, width, 3, generator=generator) ** 8)
        total = light.points(1 << 20)[1].sum(0)
        torch.testing.assert_close(cells(light, 12)[1].sum(0), total)
        middles = cells(light, 12)[0]
        torch.testing.assert_close(middles.norm(dim=1), torch.ones(12, dtype=torch.float64))


def test_a_map_with_one_bright_pixel() -> None:
    """Cells with power lie within the pixel."""
    picture = torch.zeros(16, 32, 3)
    picture[4, 9] = 3.0
    light = EnvironmentLight.build(picture)
    middle, power = cells(light, 8)
    bright = power.sum(1) > 0.0
    assert bool(bright.any())
    assert bool((light.radiance(middle[bright].float()) == 3.0).all())


def test_eye_rays_share_the_cells_out() -> None:
    fixed = FixedLights.build((STUDIO, STUDIO), 4, 3)
    assert fixed.direction.shape == fixed.irradiance.shape == (4, 6, 3)
    power = 2.0 * cells(STUDIO, 12)[1].sum(0)
    torch.testing.assert_close(fixed.irradiance.sum(1).mean(0), power)
    each = fixed.irradiance.sum((1, 2))  # each eye ray sees about the same
    assert float(each.max()) < 1.5 * float(each.min())


def test_pictures_are_without_noise_and_near_the_truth() -> None:
    settings = RenderSettings(size=32, samples=4)
    first, second = (
        render(Lambertian(), SCENE, replace(settings, seed=seed)).picture for seed in (0, 1)
    )
    assert torch.equal(first, second)
    many = RenderSettings(size=32, samples=64, light_samples=16, lighting="sampled")
    truth = render(Lambertian(), SCENE, many)
    inner = truth.coverage == 1.0
    error = (first - truth.picture)[inner].norm() / truth.picture[inner].norm()
    assert float(error) < 0.03


def test_narrow_highlights_are_sampled() -> None:
    """They would show the single directions."""
    glossy, diffuse = glossy_model(size=4), planted_model(4, names=DIFFUSE)
    assert has_narrow_highlights(glossy)
    assert has_narrow_highlights(CosineSampled(glossy))
    assert not has_narrow_highlights(diffuse)
    assert not has_narrow_highlights(Lambertian())
    settings = RenderSettings(size=16, samples=2)
    automatic = render(glossy, SCENE, settings).picture
    assert torch.equal(
        automatic, render(glossy, SCENE, replace(settings, lighting="sampled")).picture
    )
    assert not torch.equal(
        automatic, render(glossy, SCENE, replace(settings, lighting="fixed")).picture
    )
