"""Mosaic and maps: what they show, and where."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from spmm_torch import SPMM
from spmm_torch.brdf import REGISTRY
from spmm_torch.errors import ConfigError
from spmm_torch.geometry.directions import direction_from_angles
from spmm_torch.model.relief import Relief
from spmm_torch.viz.maps import (
    count_map,
    height_map,
    maps_scene,
    mean_normals,
    model_map,
    strongest_models,
)
from spmm_torch.viz.mosaic import mosaic_scene, spread_texels, texel_places
from spmm_torch.viz.palette import model_colour
from spmm_torch.viz.scene import Picture, Surface
from tests.planted.models import planted_model, planted_relief, with_relief

WO = direction_from_angles(torch.tensor(0.5), torch.tensor(1.0))


def test_texels_spread_evenly() -> None:
    assert spread_texels(4, 8, 4).tolist() == [9, 11, 13, 15, 25, 27, 29, 31]
    assert len(spread_texels(3, 3, 8)) == 9


def test_places_put_row_0_at_the_top() -> None:
    places = texel_places(torch.tensor([0, 7]), 2, 4, (1.0, 0.5))
    assert np.allclose(places, [(-0.75, 0.25, 0.0), (0.75, -0.25, 0.0)])


def test_a_mosaic_has_one_surface_for_each_model(model: SPMM) -> None:
    scene = mosaic_scene(model, 4, WO)
    surfaces = [part for part in scene.parts if isinstance(part, Surface)]
    used = {model_colour(index) for index in model.lobe_model.tolist()}
    assert {part.colour for part in surfaces} == used
    points = np.concatenate([part.points for part in surfaces])
    assert points[:, 2].min() >= 0.0
    assert len(np.unique(np.round(points[points[:, 2] < 1e-9, :2], 3), axis=0)) >= 16


@pytest.mark.parametrize("across", [0, 33])
def test_a_mosaic_of_a_wrong_size_is_refused(model: SPMM, across: int) -> None:
    with pytest.raises(ConfigError, match=f"--mosaic is {across}; expected 1 to 32"):
        mosaic_scene(model, across, WO)


def test_mean_normals_of_one_lobe_are_its_normal() -> None:
    model = planted_model(lobes_per_texel=1)
    assert torch.allclose(mean_normals(model), model.normal[model.index], atol=1e-6)


def test_the_strongest_model_of_one_lobe_is_its_own() -> None:
    model = planted_model(lobes_per_texel=1)
    assert torch.equal(strongest_models(model), model.lobe_model[model.index])


def test_texels_without_lobes_have_no_model() -> None:
    model = planted_model()
    model.weight.data.zero_()
    assert bool((strongest_models(model) == -1).all())
    assert torch.allclose(mean_normals(model)[:, 2], torch.ones(64))


def test_keys_name_what_occurs(model: SPMM) -> None:
    assert [row.text for row in count_map(model).key] == ["3"]
    titles = {brdf.title for brdf in REGISTRY}
    shown = [row.text for row in model_map(model).key]
    assert shown
    assert set(shown) <= titles


def test_a_relief_adds_a_map(model: SPMM) -> None:
    rough = with_relief(model, planted_relief(8, 8, 0.1))
    assert rough.relief is not None
    found = height_map(rough, rough.relief)
    bright = found.codes.astype(int).sum(-1).flatten()
    height = rough.relief.height
    assert bright[int(height.argmax())] > bright[int(height.argmin())]
    assert [row.text.split()[0] for row in found.key] == [
        f"{100.0 * float(bound):.3g}" for bound in (height.max(), height.min())
    ]
    scene = maps_scene(rough)
    assert len([part for part in scene.parts if isinstance(part, Picture)]) == 5
    assert scene.size[0] == 5 * maps_scene(model).size[0] // 4
    plane = Relief(None, 0.0, 0.02)
    assert [row.text for row in height_map(rough, plane).key] == ["2 % of the width"]


def test_maps_stand_side_by_side(model: SPMM) -> None:
    pictures = [part for part in maps_scene(model).parts if isinstance(part, Picture)]
    assert len(pictures) == 4
    assert all(part.codes.shape == (512, 512, 3) for part in pictures)
    centres = [part.centre[0] for part in pictures]
    assert all(
        b - a > 2.0 * pictures[0].right[0] for a, b in zip(centres, centres[1:], strict=False)
    )
