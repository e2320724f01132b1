"""Where rays start and where they lead, against geometry by hand."""

from __future__ import annotations

import math

import pytest
import torch
from torch import Tensor

from spmm_torch.errors import ConfigError
from spmm_torch.render import Camera, Plane, Sphere, Texture, turn
from spmm_torch.render.camera import DISTANCE
from spmm_torch.render.points import pixel_points

# The middle of the picture, and of its left, right, lower and upper edge.
MARKS = torch.tensor([[0.5, 0.5], [0.0, 0.5], [1.0, 0.5], [0.5, 0.0], [0.5, 1.0]])


def plane_hits(camera: Camera, at: Tensor) -> Tensor:
    """Where rays meet z = 0."""
    rays = camera.rays(at)
    return rays.origin - rays.direction * (rays.origin[:, 2:] / rays.direction[:, 2:])


def test_parallel_rays_from_the_front() -> None:
    camera = Camera.orthographic(half_width=0.5)
    rays = camera.rays(MARKS)
    torch.testing.assert_close(rays.direction, torch.tensor([0.0, 0.0, -1.0]).expand(5, 3))
    expected = torch.tensor([[0.0, 0, 0], [-0.5, 0, 0], [0.5, 0, 0], [0, -0.5, 0], [0, 0.5, 0]])
    torch.testing.assert_close(plane_hits(camera, MARKS), expected)


def test_diverging_rays_from_the_front() -> None:
    angle = math.radians(40.0)
    camera = Camera.perspective(distance=3.0, field_of_view=angle)
    rays = camera.rays(MARKS)
    torch.testing.assert_close(rays.origin, torch.tensor([0.0, 0.0, 3.0]).expand(5, 3))
    torch.testing.assert_close(rays.direction.norm(dim=1), torch.ones(5))
    away = torch.arccos(-rays.direction[:, 2])
    torch.testing.assert_close(away, torch.tensor([0.0, *[angle / 2] * 4]), atol=1e-3, rtol=0)
    edge = 3.0 * math.tan(angle / 2)
    torch.testing.assert_close(plane_hits(camera, MARKS)[4], torch.tensor([0.0, edge, 0.0]))


@pytest.mark.parametrize(
    ("theta", "phi", "right", "up"),
    [
        (90, 0, (0, 0, -1), (0, 1, 0)),  # from +x
        (90, 180, (0, 0, 1), (0, 1, 0)),  # from -x
        (180, 0, (-1, 0, 0), (0, 1, 0)),  # from behind
        (45, 270, (1, 0, 0), (0, math.sqrt(0.5), math.sqrt(0.5))),  # from below
        (90, 90, (1, 0, 0), (0, 0, -1)),  # from +y, along up itself
    ],
)
def test_up_stays_up(theta: float, phi: float, right: tuple, up: tuple) -> None:
    camera = Camera.orthographic(math.radians(theta), math.radians(phi))
    torch.testing.assert_close(
        camera.axes[0], torch.tensor(right, dtype=torch.float64), atol=1e-12, rtol=0
    )
    torch.testing.assert_close(
        camera.axes[1], torch.tensor(up, dtype=torch.float64), atol=1e-12, rtol=0
    )


def test_row_0_is_the_top() -> None:
    at = pixel_points(torch.arange(9), 3, 4, torch.Generator().manual_seed(0))
    assert at.shape == (9, 4, 2)
    column, row = torch.arange(9) % 3, torch.arange(9) // 3
    assert bool((torch.floor(at[..., 0] * 3) == column[:, None]).all())
    assert bool((torch.ceil(at[..., 1] * 3) == 3 - row[:, None]).all())


@pytest.mark.parametrize(
    ("samples", "across", "down"), [(4, 2, 2), (6, 3, 2), (5, 5, 1), (1, 1, 1)]
)
def test_each_stratum_gets_one_ray(samples: int, across: int, down: int) -> None:
    at = pixel_points(torch.arange(16), 4, samples, torch.Generator().manual_seed(1))
    x, y = torch.floor(at[..., 0] * 4 * across) % across, torch.floor(at[..., 1] * 4 * down) % down
    strata = (y * across + x).sort(dim=1).values
    assert bool((strata == torch.arange(samples)).all())


def test_sphere_hits_face_the_eye() -> None:
    at = torch.rand(500, 2, generator=torch.Generator().manual_seed(2))
    for camera in (Camera.orthographic(0.7, 2.0), Camera.perspective(0.7, 2.0)):
        rays = camera.rays(at)
        distance = Sphere().distance(rays)
        met = distance.isfinite()
        position = rays.origin[met] + distance[met, None] * rays.direction[met]
        torch.testing.assert_close(position.norm(dim=1), torch.ones(int(met.sum())))
        assert bool(((position * rays.direction[met]).sum(1) < 1e-3).all())
        assert 0.6 < float(met.float().mean()) < math.pi / 4


def test_sphere_behind_the_camera_is_not_seen() -> None:
    camera = Camera.perspective(distance=DISTANCE)
    rays = camera.rays(MARKS[:1])
    away = type(rays)(rays.origin, -rays.direction)
    assert bool(Sphere().distance(away).isinf().all())


def test_frames_of_the_sphere() -> None:
    points = torch.randn(200, 3, generator=torch.Generator().manual_seed(3))
    points = torch.cat((points, torch.eye(3), -torch.eye(3))).double()
    points = points / points.norm(dim=1, keepdim=True)
    frame, _ = Sphere().surface(points)
    eye = torch.eye(3, dtype=torch.float64).expand_as(frame)
    torch.testing.assert_close(frame @ frame.transpose(1, 2), eye)
    torch.testing.assert_close(torch.linalg.det(frame), torch.ones(len(points)).double())
    torch.testing.assert_close(frame[:, 2], points)
    front, _ = Sphere().surface(torch.tensor([[0.0, 0.0, 1.0]]))
    torch.testing.assert_close(front[0], torch.eye(3))


def test_tangents_follow_the_texture() -> None:
    shape = Sphere()
    point = torch.tensor([[0.3, 0.5, 0.6]], dtype=torch.float64)
    point = point / point.norm()
    frame, uv = shape.surface(point)
    step = 1e-6
    for axis, growing in ((0, 0), (1, 1)):
        moved = point + step * frame[:, axis]
        _, there = shape.surface(moved / moved.norm())
        change = (there - uv)[0] / step
        assert float(change[growing]) > 0.1
        assert abs(float(change[1 - growing])) < 1e-5


def test_texture_repeats_and_stays_square() -> None:
    plane = Plane(Texture(repeat=3.0, aspect=2.0))
    _, uv = plane.surface(torch.tensor([[0.0, 0, 0], [1.0, 0, 0], [0.0, 1.0, 0]]))
    torch.testing.assert_close(uv, torch.tensor([[0.5, 0.5], [2.0, 0.5], [0.5, 3.5]]))
    _, uv = Sphere(Texture(repeat=2.0)).surface(torch.tensor([[1.0, 0, 0], [0.0, 1.0, 0]]))
    torch.testing.assert_close(uv[0], torch.tensor([1.5, 0.5]))
    assert float(uv[1, 1]) == pytest.approx(1.5)


def test_plane_has_edges_and_one_side() -> None:
    camera = Camera.orthographic(half_width=2.0)
    at = torch.tensor([[0.5, 0.5], [0.74, 0.26], [0.76, 0.5], [0.5, 0.2]])
    assert Plane().distance(camera.rays(at)).isfinite().tolist() == [True, True, False, False]
    behind = Camera.orthographic(math.pi)
    assert bool(Plane().distance(behind.rays(at)).isinf().all())


def test_turning_the_camera() -> None:
    camera = Camera.perspective(math.radians(60.0), 0.0)
    position = camera.rotated(turn((0.0, 0.0, 1.0), math.radians(90.0))).position
    expected = Camera.perspective(math.radians(60.0), math.radians(90.0)).position
    torch.testing.assert_close(position, expected)
    whole = camera.rotated(turn((0.0, 1.0, 0.0), 2.0 * math.pi))
    torch.testing.assert_close(whole.axes, camera.axes)


@pytest.mark.parametrize(
    ("make", "complaint"),
    [
        (lambda: Camera.perspective(distance=0.0), "distance of the camera is 0.0"),
        (lambda: Camera.perspective(field_of_view=math.pi), "field of view is 180 degrees"),
        (lambda: Camera.orthographic(math.nan), "camera direction is"),
        (lambda: Camera.orthographic(half_width=-1.0), "half width of the camera is -1.0"),
    ],
)
def test_bad_cameras(make, complaint: str) -> None:
    with pytest.raises(ConfigError, match=complaint):
        make()
