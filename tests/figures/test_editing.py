"""The figures of edits: what they compare, and that the edits can be seen."""

from __future__ import annotations

import pytest
import torch

from spmm_torch import SPMM
from spmm_torch.edit import change_colours
from spmm_torch.figures.editing import EDITING, AsMeasured, View, figure4, figure6
from spmm_torch.geometry.directions import direction_from_angles
from spmm_torch.render import BTFMaterial, Camera, DirectionalLight, RenderSettings, Scene, Sphere
from tests.planted.btfs import tabulated
from tests.planted.models import FEW_RINGS, planted_model

ROWS = {"figure4": (4, 4), "figure5": (3,), "figure6": (3,), "figure7": (2,), "figure9": (4,)}


@pytest.fixture(scope="module")
def model() -> SPMM:
    return planted_model(rings=FEW_RINGS)


@pytest.fixture(scope="module")
def view() -> View:
    lights = (DirectionalLight.build((0.4, 0.3, 1.0)),)
    scene = Scene(Sphere(), Camera.orthographic(), lights)
    return View(scene, RenderSettings(size=12, samples=1))


def test_as_measured_is_the_btf_of_the_model(model: SPMM) -> None:
    """The material of the tabulated model, texel by texel and between texels."""
    generator = torch.Generator().manual_seed(1)
    angles = torch.rand(2, 50, 2, generator=generator) * torch.tensor([1.6, 6.28])
    wi, wo = direction_from_angles(*angles[0].T), direction_from_angles(*angles[1].T)
    uv = torch.rand(50, 2, generator=generator)
    expected = BTFMaterial.build(tabulated(model))(uv, wi, wo)
    found = AsMeasured.build(model)(uv, wi, wo)
    torch.testing.assert_close(found, expected, rtol=1e-4, atol=1e-5)


@pytest.mark.parametrize("name", EDITING)
def test_every_figure_shows_different_pictures(model: SPMM, view: View, name: str) -> None:
    found = EDITING[name](model, view)
    assert tuple(len(row) for row in found.rows) == ROWS[name]
    for row in found.rows:
        assert row[0].label == "original"
        for first, second in zip(row, row[1:], strict=False):
            assert not torch.allclose(first.picture, second.picture, rtol=1e-3)


def test_figure4_measures_what_it_shows(model: SPMM, view: View) -> None:
    found = figure4(model, view)
    edited, exact = found.rows[0][3].picture, found.rows[1][3].picture
    original = found.rows[0][0].picture
    torch.testing.assert_close(exact, change_colours(original, 0.0, 0.3))
    covered = view.of(model).coverage > 0.0
    distance = (edited - exact)[covered].norm(dim=1).mean() * found.exposure
    assert found.values["fig4_right_difference"] == pytest.approx(float(distance))
    assert 0.0 < float(distance) < 0.1


def test_figure6_is_blurrier_in_the_original_format(model: SPMM, view: View) -> None:
    values = figure6(model, view).values
    assert values["brightest, more metallic"] > 1.1 * values["brightest, original format"]
