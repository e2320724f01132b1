"""Places of hits: flat and plain reliefs, bounds, copies, gradients, footprints, and Mitsuba."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch
from torch import Tensor
from torch.nn.functional import interpolate

from spmm_torch.geometry.directions import MIRROR, REPEAT, direction_from_angles, texel_at
from spmm_torch.geometry.relief import HeightField, steepest, texel_centres
from spmm_torch.synthesize.relief import build_relief
from spmm_torch.synthesize.variant import PLAIN
from tests.planted.directions import random_directions

SLOPE = 3.0


def waves(rows: int, columns: int, amplitude: float = 0.1) -> Tensor:
    """A smooth map that repeats, of mean 0."""
    u, v = texel_centres(rows, columns, torch.zeros((), dtype=torch.float64)).unbind(-1)
    bumps = torch.sin(2.0 * math.pi * u) * torch.cos(2.0 * math.pi * v) + 0.5 * torch.cos(
        2.0 * math.pi * (2.0 * u + v)
    )
    return amplitude * bumps.view(rows, columns) / 1.5


def places(count: int, seed: int = 0, dtype: torch.dtype = torch.float64) -> Tensor:
    return torch.rand(count, 2, generator=torch.Generator().manual_seed(seed), dtype=dtype)


@pytest.mark.parametrize("gradient", [False, True])
def test_a_flat_relief_returns_the_same_bits(gradient: bool) -> None:
    field = HeightField(torch.zeros(4, 6, requires_grad=gradient), REPEAT, SLOPE)
    uv, wo = 5.0 * places(500, dtype=torch.float32) - 2.0, random_directions(500, 1).float()
    assert torch.equal(field.hit(uv, wo), uv)


def test_a_plane_shifts_every_view_by_its_height() -> None:
    field = HeightField(torch.full((4, 8), 0.05, dtype=torch.float64), REPEAT, SLOPE)
    uv, wo = places(50), random_directions(50, 2, max_theta=math.atan(SLOPE))
    expected = uv + 0.05 * wo[:, :2] / wo[:, 2:] * torch.tensor([1.0, 2.0])
    torch.testing.assert_close(field.hit(uv, wo), expected)


def test_the_shift_stays_beyond_the_steepest_view() -> None:
    field = HeightField(waves(8, 8), REPEAT, SLOPE)
    phi = torch.linspace(0.0, 6.0, 7, dtype=torch.float64)
    bound = direction_from_angles(torch.full_like(phi, math.atan(SLOPE)), phi)
    uv = places(7)
    for theta in (1.3, 0.5 * math.pi, 2.0):
        beyond = direction_from_angles(torch.full_like(phi, theta), phi)
        torch.testing.assert_close(field.hit(uv, beyond), field.hit(uv, bound))
    down = torch.tensor([0.0, 0.0, -1.0], dtype=torch.float64)
    assert torch.equal(field.hit(uv, down), uv)


def test_views_from_above_alone_shift_nothing() -> None:
    field = HeightField(torch.full((3, 4), 0.1), "repeat", 0.0)
    views = torch.tensor([[0.0, 0.0, 1.0], [0.6, 0.0, 0.8]])
    assert float(field.shift(views).abs().max()) < 1e-30


def test_the_steepest_measured_view_bounds_the_slope() -> None:
    theta = torch.deg2rad(torch.tensor([0.0, 60.0, 75.0]))
    view = direction_from_angles(theta, torch.ones(3))
    assert steepest(view, 8.0) == pytest.approx(math.tan(math.radians(75.0)), rel=1e-5)
    assert steepest(torch.tensor([[1.0, 0.0, 0.0]]), 8.0) == pytest.approx(8.0)


@pytest.mark.parametrize("rule", [REPEAT, MIRROR])
def test_copies_of_the_texture_look_alike(rule: str) -> None:
    field = HeightField(waves(6, 9) + 0.02, rule, SLOPE)
    uv, wo = places(60, 3), random_directions(60, 4)
    copy, turned = (uv + 2.0, wo) if rule == REPEAT else (-uv, wo * torch.tensor([-1.0, -1.0, 1.0]))
    found, expected = field.hit(copy, turned), field.hit(uv, wo)
    expected = expected + 2.0 if rule == REPEAT else -expected
    torch.testing.assert_close(found, expected, rtol=0.0, atol=1e-9)


def test_shapes_broadcast() -> None:
    field = HeightField(waves(5, 5), REPEAT, SLOPE)
    uv, wo = places(4), random_directions(3, 5)
    grid = field.hit(uv[:, None], wo)
    assert grid.shape == (4, 3, 2)
    torch.testing.assert_close(grid[2, 1], field.hit(uv[2], wo[1]))


@pytest.mark.parametrize("rule", [REPEAT, MIRROR])
def test_gradients_are_those_of_the_implicit_function(rule: str) -> None:
    height = waves(5, 7, 0.06).requires_grad_()
    uv = (2.0 * places(12, 6) - 0.5).requires_grad_()
    wo = random_directions(12, 7, max_theta=1.1).requires_grad_()

    def hit(height: Tensor, uv: Tensor, wo: Tensor) -> Tensor:
        return HeightField(height, rule, SLOPE).hit(uv, wo)

    assert torch.autograd.gradcheck(hit, (height, uv, wo))
    with torch.no_grad():
        plain = hit(height, uv, wo)
    assert torch.equal(hit(height, uv, wo), plain)


def test_the_place_of_a_point_shows_it() -> None:
    field = HeightField(waves(8, 4, 0.02), REPEAT, SLOPE)  # too shallow to hide a point
    uv, wo = places(80, 12), random_directions(80, 13, max_theta=0.9)
    torch.testing.assert_close(field.hit(field.place(uv, wo), wo), uv, rtol=0.0, atol=1e-9)


def test_footprints_are_lookups_of_hits() -> None:
    field = HeightField(waves(6, 4) + 0.05, MIRROR, SLOPE)
    view, drift = random_directions(5, 8, max_theta=1.2), 0.1 * places(5, 9) - 0.05
    found = field.footprint(view, drift)
    at = field.hit(texel_centres(6, 4, view) + drift[:, None], view[:, None])
    texel, weight = texel_at(at, 6, 4, MIRROR)
    assert torch.equal(found.texel, texel)
    assert torch.equal(found.weight, weight)
    assert torch.equal(found.inside, ((at >= 0.0) & (at <= 1.0)).all(-1))
    assert 0 < int(found.inside.sum()) < found.inside.numel()


def test_a_flat_footprint_is_the_texel_itself() -> None:
    found = HeightField(torch.zeros(3, 5), REPEAT, SLOPE).footprint(random_directions(4, 1).float())
    own = torch.zeros(4, 15)
    for corner in range(4):
        own += found.weight[..., corner] * (found.texel[..., corner] == torch.arange(15))
    torch.testing.assert_close(own, torch.ones(4, 15), rtol=0.0, atol=1e-5)
    assert bool(found.inside.all())


def test_mitsuba_meets_the_same_points() -> None:
    mi = pytest.importorskip("mitsuba")
    mi.set_variant(PLAIN)
    size, finer = 16, 12
    height = waves(size, size, 0.08)
    wide = torch.nn.functional.pad(height[None, None], (1, 1, 1, 1), mode="circular")
    fine = interpolate(wide, scale_factor=finer, mode="bilinear", align_corners=False)
    fine = fine[0, 0, finer:-finer, finer:-finer].numpy()
    low, high = fine.min(), fine.max()
    relief = build_relief((fine - low) / (high - low), high - low, margin=0.5)
    mean = fine.mean()  # at z = 0 of the mesh
    mesh = mi.Mesh("relief", len(relief.position), len(relief.faces))
    parameters = mi.traverse(mesh)
    parameters["vertex_positions"] = relief.position.ravel()
    parameters["faces"] = relief.faces.ravel()
    parameters.update()
    scene = mi.load_dict({"type": "scene", "relief": mesh})
    uv, wo = places(200, 10), random_directions(200, 11, max_theta=1.2)
    found = HeightField(height, REPEAT, SLOPE).hit(uv, wo).numpy()
    far = 0.5 * wo.numpy()
    plane = np.concatenate((uv.numpy(), np.full((200, 1), -mean)), axis=1)
    for start, view, expected in zip(plane + far, wo.numpy(), found, strict=True):
        met = scene.ray_intersect(mi.Ray3f(list(start), list(-view)))
        assert met.is_valid()
        assert np.hypot(met.p[0] - expected[0], met.p[1] - expected[1]) < 0.05 / size
