"""Polar plots: vertices are values, and triangles cover the hemisphere."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch

from spmm_torch import SPMM
from spmm_torch.geometry.directions import direction_from_angles
from spmm_torch.viz.polar import mirror_directions, polar_directions, polar_points, polar_triangles
from spmm_torch.viz.scene import Surface
from spmm_torch.viz.texel import luminance, texel_index, texel_lobes
from spmm_torch.viz.texel_scene import HALF_GAP, texel_scene

UP = torch.tensor([[0.0, 0.0, 1.0]], dtype=torch.float64)
WO = direction_from_angles(torch.tensor(0.7), torch.tensor(0.0)).double()


def test_directions_are_upper_unit_vectors() -> None:
    directions = polar_directions(torch.cat((UP, WO[None])))
    assert torch.allclose(directions.norm(dim=-1), torch.ones(()).double())
    assert bool((directions[:, 2] > 0.0).all())


def test_directions_are_dense_about_a_peak() -> None:
    plain, dense = (polar_directions(peaks) for peaks in (UP[:0], WO[None]))
    near = [int((d @ WO > math.cos(0.01)).sum()) for d in (plain, dense)]
    assert near[1] > near[0] + 100


def test_triangles_cover_the_hemisphere_once() -> None:
    directions = polar_directions(UP, 400, 60)
    corners = directions.numpy()[polar_triangles(directions)]  # [F, 3, 3]
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = 0.5 * np.linalg.norm(cross, axis=1).sum()
    assert area == pytest.approx(2.0 * math.pi, rel=0.02)


def test_a_mirror_direction_lies_on_the_other_side() -> None:
    mirrored = mirror_directions(WO, UP)[0]
    assert torch.allclose(mirrored, WO * torch.tensor([-1.0, -1.0, 1.0]).double())


def test_points_lie_at_their_value() -> None:
    directions = polar_directions(UP, 100, 24)
    values = torch.linspace(0.0, 3.0, len(directions))
    points = polar_points(directions, values, scale=0.5)
    assert np.allclose(np.linalg.norm(points, axis=1), 0.5 * values.numpy())


def test_vertex_radii_of_a_scene_are_luminances_of_the_model(model: SPMM) -> None:
    """On the left are the lobes, on the right is the model without its residual."""
    texel = texel_index(model, 5, 2)
    scene = texel_scene("t", texel_lobes(model, texel), WO)
    surfaces = [part for part in scene.parts if isinstance(part, Surface)]
    assert len(surfaces) == 4
    right = np.array([HALF_GAP, 0.0, 0.0])
    total = surfaces[-1].points - right
    radius = np.linalg.norm(total, axis=1)
    assert radius.max() == pytest.approx(1.0)
    seen = radius > 1e-3
    wi = torch.from_numpy(total[seen] / radius[seen, None]).float()
    uv = torch.tensor([5.5 / 8.0, 1.0 - 2.5 / 8.0])
    with torch.no_grad():
        expected = luminance(model(uv, wi, WO.float(), residual=False)).numpy()
    assert np.allclose(radius[seen] / radius.max(), expected / expected.max(), atol=2e-4)
    lobes = sum(np.linalg.norm(part.points + right, axis=1) for part in surfaces[:-1])
    assert np.allclose(lobes, radius, atol=1e-5)
