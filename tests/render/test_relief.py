"""A relief on shapes: a raised plane stands where geometry puts it, in units of the texture."""

from __future__ import annotations

import math

import pytest
import torch
from torch import Tensor

from spmm_torch.geometry.directions import REPEAT
from spmm_torch.geometry.relief import HeightField
from spmm_torch.render import (
    Camera,
    DirectionalLight,
    Plane,
    RenderSettings,
    Scene,
    Sphere,
    Texture,
    render,
)
from spmm_torch.render.renderer import trace
from tests.planted.models import planted_model, planted_relief, with_relief

HEIGHT = 0.03  # texture widths


def raised(height: float, rows: int, columns: int) -> HeightField:
    """A plane of that height over a texture of H x W texels."""
    return HeightField(torch.full((rows, columns), height, dtype=torch.float64), REPEAT, 8.0)


@pytest.mark.parametrize("azimuth", [0.0, 0.9, 2.5, 4.0])
@pytest.mark.parametrize(("repeat", "rows", "columns"), [(1.0, 4, 4), (2.5, 4, 12)])
def test_a_raised_plane_is_met_where_rays_cross_it(
    azimuth: float, repeat: float, rows: int, columns: int
) -> None:
    shape = Plane(Texture(repeat, columns / rows))
    sun = DirectionalLight.build((0.0, 0.0, 1.0))
    camera = Camera.orthographic(1.0, azimuth)
    like = torch.zeros((), dtype=torch.float64)
    settings = RenderSettings(size=12, samples=1)
    generator = torch.Generator().manual_seed(0)
    hits = trace(Scene(shape, camera, (sun,)), settings, slice(0, 144), like, generator)
    away = camera.axes[2]  # world axes, towards the camera
    width = 2.0 / repeat  # of one copy of the texture in the world
    higher = hits.position + HEIGHT * width / away[2] * away
    _, expected = shape.surface(higher)
    found = raised(HEIGHT, rows, columns).hit(hits.uv, hits.wo)
    torch.testing.assert_close(found, expected, rtol=0.0, atol=1e-6)


def test_a_thin_shell_of_a_sphere_is_met_in_its_middle() -> None:
    """Near the front, where the texture is not squeezed by longitude, to first order."""
    shape, thin = Sphere(Texture(2.0, 1.0)), 1e-4
    position = torch.tensor([[0.2, 0.0, 1.0], [-0.3, 0.02, 1.0]], dtype=torch.float64)
    position = position / position.norm(dim=-1, keepdim=True)
    frame, uv = shape.surface(position)
    away = torch.tensor([0.6, 0.5, 1.0], dtype=torch.float64)
    away = away / away.norm()
    wo = frame @ away
    width = math.pi / 2.0  # of one copy of the texture along the equator
    found = raised(thin, 4, 4).hit(uv, wo)
    _, expected = shape.surface(position + thin * width / wo[:, 2:] * away)
    moved = (expected - uv).norm(dim=-1)
    assert bool(((found - expected).norm(dim=-1) < 2e-3 * moved).all())


def test_pictures_show_the_relief() -> None:
    flat = planted_model(residual=0.05)
    rough = with_relief(flat, planted_relief(8, 8, 0.1))
    sun = DirectionalLight.build((-1.0, 1.0, 1.5))

    def picture(model: torch.nn.Module, theta: float) -> Tensor:
        scene = Scene(Plane(Texture()), Camera.orthographic(theta), (sun,))
        return render(model, scene, RenderSettings(size=24, samples=1)).picture

    torch.testing.assert_close(picture(rough, 0.0), picture(flat, 0.0), rtol=1e-4, atol=1e-5)
    assert not torch.allclose(picture(rough, 1.0), picture(flat, 1.0), rtol=0.1)
