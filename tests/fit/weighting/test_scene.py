"""Weights of scenes whose pictures are known beforehand."""

from __future__ import annotations

import math

import pytest
import torch

from spmm_torch import BTF
from spmm_torch.errors import ConfigError
from spmm_torch.fit.weighting import scene_weights
from spmm_torch.geometry.directions import ring_directions
from spmm_torch.render import (
    BTFMaterial,
    Camera,
    DirectionalLight,
    EnvironmentLight,
    Plane,
    RenderSettings,
    Scene,
    Sphere,
    Texture,
)
from tests.planted.btfs import random_btf

RINGS = ((0.0, 1), (40.0, 6), (70.0, 8))
DIRECTIONS = ring_directions(RINGS)
COUNT, SIDE = len(DIRECTIONS), 4
QUICK = RenderSettings(size=24, samples=2, light_samples=8)


@pytest.fixture(scope="module")
def btf() -> BTF:
    return random_btf(DIRECTIONS, SIDE, SIDE)


def light_from(index: int, irradiance: float = 1.0) -> DirectionalLight:
    return DirectionalLight.build(DIRECTIONS[index].tolist(), [irradiance] * 3)


def plane(*lights: DirectionalLight) -> Scene:
    """A plane that is looked at straight from above."""
    return Scene(Plane(), Camera.orthographic(), lights)


def test_one_measured_pair_has_all_weight(btf: BTF) -> None:
    weights = scene_weights(btf, plane(light_from(3)), QUICK, "here")
    assert weights.pair[3] == pytest.approx(COUNT * COUNT, rel=1e-4)
    assert weights.texel.mean() == pytest.approx(1.0)
    assert weights.texel.std() < 0.5  # the texture lies evenly on the plane


def test_pairs_count_by_the_radiance_squared(btf: BTF) -> None:
    scene = plane(light_from(3, 2.0), light_from(5, 1.0))
    weights = scene_weights(btf, scene, QUICK, "here")
    # By coefficient times the whole light: 2 * 3 against 1 * 3.
    assert weights.pair[3] / weights.pair[5] == pytest.approx(2.0, rel=1e-3)
    brighter = scene_weights(btf, plane(light_from(3, 200.0)), QUICK, "here")
    one = scene_weights(btf, plane(light_from(3, 2.0)), QUICK, "here")
    torch.testing.assert_close(brighter.pair, one.pair, rtol=1e-3, atol=1e-3)


def test_between_directions_the_material_tells_which_count(btf: BTF) -> None:
    light = DirectionalLight.build((0.2, 0.1, 1.0))
    weights = scene_weights(btf, plane(light), QUICK, "here")
    wi = light.direction.float()[None, None]
    wo = torch.tensor([[[0.0, 0.0, 1.0]]])
    index, share = BTFMaterial.build(btf).pairs_at(wi, wo, wi.shape[:2])
    expected = torch.zeros(COUNT * COUNT).index_add(0, index.flatten(), share.flatten())
    torch.testing.assert_close(weights.pair / len(weights.pair), expected, rtol=1e-3, atol=1e-4)


def test_texels_out_of_sight_weigh_nothing(btf: BTF) -> None:
    camera = Camera.orthographic(half_width=0.2)  # the middle of the plane only
    scene = Scene(Plane(Texture()), camera, (light_from(0),))
    texel = scene_weights(btf, scene, QUICK, "here").texel.view(SIDE, SIDE)
    assert bool((texel[1:3, 1:3] > 0.0).all())
    assert float(texel[1:3, 1:3].sum()) == pytest.approx(SIDE * SIDE, rel=1e-4)


def test_an_environment_lights_many_pairs(btf: BTF) -> None:
    scene = Scene(Sphere(Texture(2.0)), Camera.orthographic(), (EnvironmentLight.studio(),))
    weights = scene_weights(btf, scene, QUICK, "here")
    assert (weights.pair > 0.0).float().mean() > 0.5
    assert weights.pair.isfinite().all()
    again = scene_weights(btf, scene, QUICK, "here")
    assert torch.equal(weights.pair, again.pair)


@pytest.mark.parametrize(
    ("scene", "message"),
    [
        (
            Scene(Plane(), Camera.orthographic(math.pi), (light_from(0),)),
            "its camera sees nothing of the shape",
        ),
        (
            Scene(Plane(), Camera.orthographic(), (DirectionalLight.build((0.0, 0.0, -1.0)),)),
            "no light reaches what it sees",
        ),
    ],
)
def test_a_scene_that_shows_nothing(btf: BTF, scene: Scene, message: str) -> None:
    with pytest.raises(ConfigError) as error:
        scene_weights(btf, scene, QUICK, "dark.yaml")
    assert f"scene dark.yaml shows nothing: {message}" in str(error.value)
