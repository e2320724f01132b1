"""Whole pictures against analytic ones."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import pytest
import torch
from torch import Tensor

from spmm_torch.errors import ConfigError
from spmm_torch.render import (
    Camera,
    CosineSampled,
    DirectionalLight,
    EnvironmentLight,
    Plane,
    PointLight,
    RenderSettings,
    Scene,
    Sphere,
    render,
    renderer,
    turn,
)
from tests.planted.materials import Lambertian
from tests.planted.models import planted_model

ALBEDO = (0.8, 0.5, 0.2)
FRONT = Camera.orthographic()
SUN = DirectionalLight.build((1.0, 2.0, 2.0), (3.0, 2.0, 1.0))
GREY = EnvironmentLight.build(torch.ones(8, 16, 3))


def centres(size: int, half_width: float) -> tuple[Tensor, Tensor]:
    """x and y `[size, size]` of pixel centres in the plane of the origin."""
    step = ((torch.arange(size) + 0.5) / size * 2.0 - 1.0) * half_width
    return step.expand(size, size), -step[:, None].expand(size, size)


def test_lambertian_sphere_under_the_sun() -> None:
    settings = RenderSettings(size=64, samples=64)
    result = render(Lambertian(ALBEDO), Scene(Sphere(), FRONT, (SUN,)), settings)
    x, y = centres(64, FRONT.half_width)
    z = torch.sqrt((1.0 - x * x - y * y).clamp(min=0.0))
    cosine = (torch.stack((x, y, z), dim=-1) @ torch.tensor([1.0, 2.0, 2.0]) / 3.0).clamp(min=0.0)
    expected = cosine[..., None] * torch.tensor(ALBEDO) * torch.tensor([3.0, 2.0, 1.0]) / math.pi
    inner = x * x + y * y < 0.85**2
    torch.testing.assert_close(result.picture[inner], expected[inner], atol=6e-3, rtol=0.0)
    assert bool((result.picture[x * x + y * y > 1.1] == 0.0).all())
    area = float(result.coverage.mean()) * (2.0 * FRONT.half_width) ** 2
    assert area == pytest.approx(math.pi, rel=2e-3)


@pytest.mark.parametrize("light", [SUN, GREY], ids=["sun", "environment"])
def test_a_differentiable_picture(light: DirectionalLight | EnvironmentLight) -> None:
    """A picture is linear in an albedo, so its derivative is that of albedo 1."""
    albedo = torch.full((3,), 0.4, requires_grad=True)

    def material(uv: Tensor, wi: Tensor, wo: Tensor) -> Tensor:
        return albedo * wi[..., 2:].clamp(min=0.0)

    scene, settings = Scene(Sphere(), FRONT, (light,)), RenderSettings(size=12, samples=2)
    picture = render(material, scene, settings, differentiable=True).picture
    (slope,) = torch.autograd.grad(picture.sum(), albedo)
    torch.testing.assert_close(slope, picture.detach().sum((0, 1)) / 0.4)
    plain = render(material, scene, settings).picture
    assert torch.equal(plain, picture) and not plain.requires_grad


def test_several_lights_add_up() -> None:
    lights = (SUN, PointLight.build((2.0, 0.0, 3.0)), DirectionalLight.build((-1.0, 0.0, 0.5)))
    settings = RenderSettings(size=24, samples=2)
    together = render(Lambertian(), Scene(Sphere(), FRONT, lights), settings).picture
    each = [render(Lambertian(), Scene(Sphere(), FRONT, (x,)), settings).picture for x in lights]
    torch.testing.assert_close(together, sum(each))


def test_point_light_falls_off_with_the_square() -> None:
    height, settings = 1.5, RenderSettings(size=32, samples=64)
    light = PointLight.build((0.2, -0.3, height), (5.0, 5.0, 5.0))
    camera = Camera.orthographic(half_width=1.0)
    found = render(Lambertian(), Scene(Plane(), camera, (light,)), settings).picture[..., 0]
    x, y = centres(32, 1.0)
    squared = (x - 0.2) ** 2 + (y + 0.3) ** 2 + height**2
    expected = 5.0 * height / squared**1.5 / math.pi
    torch.testing.assert_close(found, expected, rtol=5e-3, atol=0.0)


def test_white_furnace() -> None:
    settings = RenderSettings(size=16, samples=16, light_samples=32)
    for shape in (Sphere(), Plane()):
        result = render(Lambertian(ALBEDO), Scene(shape, FRONT, (GREY,)), settings)
        met = result.coverage > 0.0
        reflected = result.picture[met] / result.coverage[met][:, None]
        expected = torch.tensor(ALBEDO).expand_as(reflected)
        torch.testing.assert_close(reflected, expected, rtol=0.03, atol=0.0)
        torch.testing.assert_close(reflected.mean(0), expected[0], rtol=5e-3, atol=0.0)


def test_turning_everything_changes_nothing() -> None:
    settings = RenderSettings(size=24, samples=4)
    rotation = turn((0.0, 0.6, 0.8), 1.0)
    lights = (SUN, PointLight.build((2.0, 1.0, 3.0)), EnvironmentLight.studio())
    here = render(Lambertian(), Scene(Sphere(), FRONT, lights), settings).picture
    moved = tuple(light.rotated(rotation) for light in lights)
    there = render(Lambertian(), Scene(Sphere(), FRONT.rotated(rotation), moved), settings).picture
    torch.testing.assert_close(there.mean((0, 1)), here.mean((0, 1)), rtol=5e-3, atol=0.0)
    sun = [Scene(Sphere(), FRONT, (SUN,)), Scene(Sphere(), FRONT.rotated(rotation), moved[:1])]
    pictures = [render(Lambertian(), scene, settings).picture for scene in sun]
    torch.testing.assert_close(pictures[1], pictures[0], atol=1e-4, rtol=0.0)


def everything() -> Scene:
    return Scene(Sphere(), Camera.perspective(0.3, 1.0), (SUN, EnvironmentLight.studio()))


def test_the_same_seed_gives_the_same_picture() -> None:
    settings = RenderSettings(size=16, samples=2, light_samples=2, lighting="sampled")
    first, again = (render(planted_model(), everything(), settings).picture for _ in range(2))
    assert torch.equal(first, again)
    other = render(planted_model(), everything(), replace(settings, seed=1)).picture
    assert not torch.allclose(first, other)


def test_block_sizes_change_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    settings = RenderSettings(size=16, samples=3, light_samples=2)
    whole = render(Lambertian(), everything(), settings)
    monkeypatch.setattr(renderer, "BLOCK_EYE_RAYS", 100)
    monkeypatch.setattr(renderer, "BLOCK_DIRECTIONS", 50)
    told: list[int] = []
    parts = render(Lambertian(), everything(), settings, progress=told.append)
    torch.testing.assert_close(parts.picture, whole.picture)
    torch.testing.assert_close(parts.coverage, whole.coverage)
    assert sum(told) == 16 * 16 * 3
    assert len(told) > 5


def test_type_follows() -> None:
    settings = RenderSettings(size=8, samples=1)
    result = render(Lambertian(), everything(), settings, dtype=torch.float64)
    assert result.picture.dtype == result.coverage.dtype == torch.float64


def test_nothing_is_recorded_for_gradients() -> None:
    model = planted_model()
    assert model.weight.requires_grad
    picture = render(model, everything(), RenderSettings(size=4, samples=1)).picture
    assert not picture.requires_grad


def test_a_model_is_sampled_without_bias() -> None:
    """By its own sampler, or by the cosine where it has none, the picture is the same."""
    model = planted_model(names=("lambertian", "blinn_phong", "lafortune"))
    scene = Scene(Sphere(), FRONT, (EnvironmentLight.studio(),))
    settings = RenderSettings(size=8, samples=64, light_samples=16, lighting="sampled")
    own = render(model, scene, settings).picture
    cosine = render(CosineSampled(model), scene, replace(settings, seed=1)).picture
    assert float((own - cosine).norm() / own.norm()) < 0.03
    torch.testing.assert_close(own.mean((0, 1)), cosine.mean((0, 1)), rtol=0.01, atol=0.0)


@pytest.mark.gpu
def test_gpu_renders_the_same_picture() -> None:
    settings = RenderSettings(size=48, samples=4)
    model = planted_model(residual=0.05)
    host = render(model, everything(), settings).picture
    device = render(model.to("cuda"), everything(), settings, "cuda").picture.cpu()
    different = (device - host).abs() > 1e-3 * host.abs() + 1e-4
    assert float(different.float().mean()) < 0.02  # rays that graze an edge of a pixel or a texel
    assert float((device - host).mean().abs()) < 1e-3 * float(host.mean())


@pytest.mark.parametrize(
    ("make", "complaint"),
    [
        (lambda: Scene(Sphere(), FRONT, ()), "no light"),
        (
            lambda: Scene(Sphere(), Camera.perspective(distance=0.9), (SUN,)),
            "inside the sphere",
        ),
        (lambda: RenderSettings(size=0), "size is 0"),
        (lambda: RenderSettings(samples=-1), "samples is -1"),
        (lambda: RenderSettings(light_samples=0), "light_samples is 0"),
        (lambda: DirectionalLight.build((0.0, 0.0, 0.0)), "expected a direction"),
        (lambda: DirectionalLight.build((0.0, 0.0, 1.0), (1.0, -1.0, 0.0)), "not below 0"),
        (lambda: PointLight.build((0.0, math.inf, 1.0)), "three finite numbers"),
        (lambda: PointLight.build((0.0, 0.0, 1.0), (0.0, 0.0, 0.0)), "is black"),
    ],
)
def test_bad_scenes(make: Callable[[], object], complaint: str) -> None:
    with pytest.raises(ConfigError, match=complaint):
        make()


@pytest.mark.parametrize("theta", [90.0, 180.0])
def test_a_camera_behind_the_plane_sees_nothing(theta: float) -> None:
    for camera in (Camera.orthographic, Camera.perspective):
        scene = Scene(Plane(), camera(math.radians(theta)), (SUN,))
        with pytest.raises(ConfigError, match="sees nothing of the plane"):
            render(Lambertian(), scene, RenderSettings(size=4, samples=1))
