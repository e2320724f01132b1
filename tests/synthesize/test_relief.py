"""The triangles of a relief: where they lie, which way they face, and that they repeat."""

from __future__ import annotations

import numpy as np
import pytest

from spmm_torch.synthesize.relief import build_relief, needed_margin

HEIGHT = np.random.default_rng(0).random((6, 8)).astype(np.float32)
RELIEF = 0.2


def test_the_mean_height_is_the_reference_plane() -> None:
    mesh = build_relief(HEIGHT, RELIEF, margin=0.0)
    inside = ((mesh.uv > 0.0) & (mesh.uv < 1.0)).all(axis=1)
    z = mesh.position[inside, 2]
    assert len(z) == HEIGHT.size
    assert z.mean() == pytest.approx(0.0, abs=1e-6)
    assert np.ptp(z) == pytest.approx(RELIEF * np.ptp(HEIGHT), rel=1e-6)


def test_row_0_is_the_top() -> None:
    mesh = build_relief(HEIGHT, RELIEF, margin=0.0)
    top_left = np.array((0.5 / 8, (6 - 0.5) / 8))  # the centre of pixel [0, 0]; y ends at 6 / 8
    vertex = np.linalg.norm(mesh.position[:, :2] - top_left, axis=1).argmin()
    np.testing.assert_allclose(mesh.position[vertex, :2], top_left, atol=1e-6)
    expected = RELIEF * (HEIGHT[0, 0] - HEIGHT.mean())
    assert mesh.position[vertex, 2] == pytest.approx(expected, abs=1e-6)
    np.testing.assert_allclose(mesh.uv[vertex], (0.5 / 8, 0.5 / 6), atol=1e-6)


def test_all_triangles_face_up() -> None:
    mesh = build_relief(HEIGHT, RELIEF, margin=0.5)
    first, second, third = np.moveaxis(mesh.position[mesh.faces], 1, 0)
    assert (np.cross(second - first, third - first)[:, 2] > 0.0).all()


@pytest.mark.parametrize("margin", [0.0, 0.3, 1.7])
def test_the_mesh_covers_its_margin_with_repeats(margin: float) -> None:
    mesh = build_relief(HEIGHT, RELIEF, margin)
    low, high = mesh.position.min(axis=0), mesh.position.max(axis=0)
    assert (low[:2] <= -margin).all()
    assert (high[:2] >= np.array((1.0, 0.75)) + margin).all()
    cell = np.floor(mesh.uv * (8, 6)).astype(int)
    expected = RELIEF * (HEIGHT - HEIGHT.mean())[cell[:, 1] % 6, cell[:, 0] % 8]
    np.testing.assert_allclose(mesh.position[:, 2], expected, atol=1e-6)


def test_given_normals_go_with_their_pixels() -> None:
    normal = np.random.default_rng(1).random((6, 8, 3)) + 0.1
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    mesh = build_relief(HEIGHT, RELIEF, 0.4, normal)
    cell = np.floor(mesh.uv * (8, 6)).astype(int)
    np.testing.assert_allclose(mesh.normal, normal[cell[:, 1] % 6, cell[:, 0] % 8], atol=1e-6)


def test_the_margin_holds_three_grazing_passes() -> None:
    steep = np.radians(75.0)
    assert needed_margin(0.1, float(np.cos(steep))) == pytest.approx(0.3 * np.tan(steep))
    assert needed_margin(0.0, 0.5) == 0.0
