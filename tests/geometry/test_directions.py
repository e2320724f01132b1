"""The conventions, with test vectors."""

from __future__ import annotations

import math

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from torch import Tensor

from spmm_torch.geometry.directions import (
    MAX_TILT,
    MIRROR,
    NEIGHBOUR_ROWS,
    UBO2014_RINGS,
    angular_spacing,
    direction_from_angles,
    direction_pairs,
    disk_from_normal,
    frame_from_normal,
    hemisphere_spiral,
    normal_from_disk,
    project_disk,
    ring_directions,
    texel_at,
)
from tests.largest_tensor import LargestTensor
from tests.planted.directions import random_directions


def vector(*values: float) -> Tensor:
    return torch.tensor(values, dtype=torch.float64)


@pytest.mark.parametrize(
    ("theta", "phi", "expected"),
    [
        (0.0, 0.0, (0.0, 0.0, 1.0)),
        (90.0, 0.0, (1.0, 0.0, 0.0)),
        (90.0, 90.0, (0.0, 1.0, 0.0)),
        (90.0, 180.0, (-1.0, 0.0, 0.0)),
        (30.0, 270.0, (0.0, -0.5, math.sqrt(0.75))),
        (60.0, 45.0, (math.sqrt(0.375), math.sqrt(0.375), 0.5)),
    ],
)
def test_direction_vectors(theta: float, phi: float, expected: tuple[float, ...]) -> None:
    angles = vector(math.radians(theta), math.radians(phi))
    torch.testing.assert_close(direction_from_angles(angles[0], angles[1]), vector(*expected))


def test_ubo2003_directions() -> None:
    directions = ring_directions()
    assert directions.shape == (81, 3)
    assert directions.dtype == torch.float32
    torch.testing.assert_close(directions.norm(dim=1), torch.ones(81))
    torch.testing.assert_close(directions[0].double(), vector(0.0, 0.0, 1.0))
    # The first of each ring lies on +x, the next one counter-clockwise of it.
    angle = math.radians(15.0)
    first = vector(math.sin(angle), 0.0, math.cos(angle))
    torch.testing.assert_close(directions[1].double(), first, rtol=0.0, atol=1e-6)
    assert directions[2, 1] > 0.0
    assert float(directions[:, 2].min()) == pytest.approx(math.cos(math.radians(75.0)), abs=1e-6)
    assert len(torch.unique(directions, dim=0)) == 81


def test_ubo2014_directions() -> None:
    directions = ring_directions(UBO2014_RINGS)
    assert directions.shape == (151, 3)
    assert len(torch.unique(directions, dim=0)) == 151


def test_direction_pairs_run_over_lights_first() -> None:
    light, view = random_directions(4, seed=1), random_directions(3, seed=2)
    wi, wo = direction_pairs(light, view)
    assert wi.shape == wo.shape == (12, 3)
    for index_view in range(3):
        for index_light in range(4):
            pair = index_view * 4 + index_light
            assert torch.equal(wi[pair], light[index_light])
            assert torch.equal(wo[pair], view[index_view])


def test_angular_spacing() -> None:
    assert angular_spacing(vector(0.0, 0.0, 1.0)[None]) == pytest.approx(math.pi / 2.0)
    theta = torch.arange(5, dtype=torch.float64) * 0.1
    line = direction_from_angles(theta, torch.zeros_like(theta))
    assert angular_spacing(line) == pytest.approx(0.1)
    assert math.degrees(angular_spacing(ring_directions())) == pytest.approx(15.0, abs=2.0)


def test_spacing_of_thousands_of_directions_takes_no_table_of_their_squares() -> None:
    """As a table of all pairs tells it, but with a part of that table at a time."""
    many = random_directions(2 * NEIGHBOUR_ROWS + 7, seed=5)
    cosines = (many @ many.T).fill_diagonal_(-1.0)
    with LargestTensor() as largest:
        spacing = angular_spacing(many)
    assert spacing == pytest.approx(float(cosines.amax(1).arccos().median()), rel=1e-9)
    assert 0 < largest.numel <= NEIGHBOUR_ROWS * len(many)


def test_disk_maps_are_inverse() -> None:
    normal = random_directions(500, seed=3)
    disk = disk_from_normal(normal)
    assert float(disk.norm(dim=1).max()) <= 1.0 + 1e-12
    torch.testing.assert_close(normal_from_disk(disk), normal)
    torch.testing.assert_close(disk_from_normal(normal_from_disk(disk)), disk)


def test_disk_preserves_area() -> None:
    """Directions even by area fill the disk evenly: the mean squared radius is one half."""
    radius_squared = disk_from_normal(random_directions(20_000, seed=4)).square().sum(dim=1)
    assert float(radius_squared.mean()) == pytest.approx(0.5, abs=0.01)


def test_disk_slopes_are_finite_on_the_closed_disk() -> None:
    disk = torch.tensor([[0.0, 0.0], [1.0, 0.0], [0.0, -1.0]], dtype=torch.float64)
    assert torch.autograd.gradcheck(normal_from_disk, disk.requires_grad_())


@given(x=st.floats(-3.0, 3.0), y=st.floats(-3.0, 3.0))
def test_project_disk(x: float, y: float) -> None:
    disk = vector(x, y)
    projected = project_disk(disk)
    tilt = torch.arccos(normal_from_disk(projected)[2])
    assert float(tilt) <= MAX_TILT + 1e-9
    torch.testing.assert_close(project_disk(projected), projected)
    # It keeps the azimuth, and moves nothing that is inside.
    assert float(projected[0] * y - projected[1] * x) == pytest.approx(0.0, abs=1e-12)
    if float(disk.norm()) < float(projected.norm()) + 1e-9:
        torch.testing.assert_close(projected, disk)


def test_frames_are_rotations_that_take_the_normal_to_z() -> None:
    normal = random_directions(200, seed=5)
    angle = torch.linspace(-4.0, 4.0, 200, dtype=torch.float64)
    frame = frame_from_normal(normal, angle)  # [200, 3, 3]
    identity = torch.eye(3, dtype=torch.float64).expand(200, 3, 3)
    torch.testing.assert_close(frame @ frame.transpose(1, 2), identity)
    torch.testing.assert_close(torch.linalg.det(frame), torch.ones(200, dtype=torch.float64))
    up = (frame @ normal[..., None]).squeeze(-1)
    torch.testing.assert_close(up, vector(0.0, 0.0, 1.0).expand(200, 3))


def test_frame_vectors() -> None:
    flat = frame_from_normal(vector(0.0, 0.0, 1.0), vector(0.0).squeeze())
    torch.testing.assert_close(flat, torch.eye(3, dtype=torch.float64))
    # A quarter turn counter-clockwise takes the tangent from +x to +y.
    turned = frame_from_normal(vector(0.0, 0.0, 1.0), vector(math.pi / 2.0).squeeze())
    torch.testing.assert_close(turned[0], vector(0.0, 1.0, 0.0))
    torch.testing.assert_close(turned[1], vector(-1.0, 0.0, 0.0))
    # A normal tilted towards +x tips the tangent down and leaves the bitangent alone.
    sine, cosine = math.sin(0.7), math.cos(0.7)
    tilted = frame_from_normal(vector(sine, 0.0, cosine), vector(0.0).squeeze())
    torch.testing.assert_close(tilted[0], vector(cosine, 0.0, -sine))
    torch.testing.assert_close(tilted[1], vector(0.0, 1.0, 0.0))


def test_spiral_normals_are_even_and_within_the_cap() -> None:
    normals = hemisphere_spiral(400)
    assert normals.shape == (400, 3)
    torch.testing.assert_close(normals.norm(dim=1), torch.ones(400))
    assert float(torch.arccos(normals[:, 2]).max()) < MAX_TILT
    # Even by area: heights are even, azimuths balance, and no two points are close.
    height = (1.0 + math.cos(MAX_TILT)) / 2.0
    assert float(normals[:, 2].mean()) == pytest.approx(height, abs=1e-4)
    assert float(normals[:, :2].mean(dim=0).norm()) < 0.01
    cosines = (normals @ normals.T).fill_diagonal_(-1.0)
    assert float(torch.arccos(cosines.max())) > 0.5 * math.sqrt(2.0 * math.pi / 400)


def test_one_spiral_normal_is_upper() -> None:
    assert float(hemisphere_spiral(1)[0, 2]) > 0.0


def test_texel_centres() -> None:
    """Row 0 is the top: u right, v up."""
    height, width = 3, 4
    for row in range(height):
        for column in range(width):
            uv = vector((column + 0.5) / width, 1.0 - (row + 0.5) / height)
            index, weight = texel_at(uv, height, width)
            share = torch.zeros(height * width, dtype=torch.float64)
            share.index_add_(0, index, weight)
            expected = torch.zeros_like(share)
            expected[row * width + column] = 1.0
            torch.testing.assert_close(share, expected)


def test_texels_between_centres_and_over_the_border() -> None:
    index, weight = texel_at(vector(0.5, 0.5), 2, 2)
    assert sorted(index.tolist()) == [0, 1, 2, 3]
    torch.testing.assert_close(weight, torch.full((4,), 0.25, dtype=torch.float64))
    # u = 0 lies between the last column and the first; v = 0.75 is the centre of row 0.
    index, weight = texel_at(vector(0.0, 0.75), 2, 4)
    shares = {i: w for i, w in zip(index.tolist(), weight.tolist(), strict=True) if w > 0.0}
    assert shares == {3: 0.5, 0: 0.5}


@given(u=st.floats(-3.0, 3.0), v=st.floats(-3.0, 3.0))
def test_textures_repeat(u: float, v: float) -> None:
    image = torch.rand(5 * 7, generator=torch.Generator().manual_seed(6), dtype=torch.float64)

    def look_up(uv: Tensor) -> Tensor:
        index, weight = texel_at(uv, 5, 7)
        assert bool((index >= 0).all()) and bool((index < 35).all())
        assert float(weight.sum()) == pytest.approx(1.0)
        assert bool((weight >= 0.0).all())
        return (image[index] * weight).sum()

    there, again = look_up(vector(u, v)), look_up(vector(u + 1.0, v - 2.0))
    torch.testing.assert_close(there, again)


def test_texel_at_is_batched() -> None:
    uv = torch.rand(2, 3, 2, generator=torch.Generator().manual_seed(7))
    index, weight = texel_at(uv, 4, 4)
    assert index.shape == weight.shape == (2, 3, 4)
    assert weight.dtype == torch.float32


def test_a_mirrored_texture_is_reversed_in_every_second_copy() -> None:
    values = torch.rand(4, 6, generator=torch.Generator().manual_seed(1), dtype=torch.float64)
    twice = torch.cat((values, values.flip(1)), dim=1)
    twice = torch.cat((twice.flip(0), twice))  # row 0 is the top, v = 0 the bottom
    uv = 6.0 * torch.rand(50, 2, generator=torch.Generator().manual_seed(2)).double() - 3.0
    index, weight = texel_at(uv, 4, 6, MIRROR)
    expected, expected_weight = texel_at(0.5 * uv, 8, 12)
    found = (values.flatten()[index] * weight).sum(-1)
    torch.testing.assert_close(found, (twice.flatten()[expected] * expected_weight).sum(-1))
