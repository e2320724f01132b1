"""Scenes as YAML files."""

from __future__ import annotations

from pathlib import Path

import pytest

from spmm_torch.config.render import SHAPE_NAMES, SceneConfig
from spmm_torch.errors import ConfigError
from spmm_torch.render import DirectionalLight, EnvironmentLight, Plane, RenderSettings
from spmm_torch.render.scene_file import read_scene, scene_of
from spmm_torch.render.shapes import SHAPES

FULL = """
shape: plane
repeat: 3.0
camera: perspective:30,90,5
lights: [studio, "directional:45,90"]
size: 32
samples: 2
light_samples: 8
seed: 3
"""


def write(path: Path, text: str) -> Path:
    path.write_text(text, encoding="utf-8")
    return path


def test_every_key(tmp_path: Path) -> None:
    config = read_scene(write(tmp_path / "scene.yaml", FULL))
    assert config.settings == RenderSettings(32, 2, 8, 3)
    scene = scene_of(config, aspect=2.0)
    assert isinstance(scene.shape, Plane)
    assert (scene.shape.texture.repeat, scene.shape.texture.aspect) == (3.0, 2.0)
    assert scene.camera.distance == 5.0
    assert [type(light) for light in scene.lights] == [EnvironmentLight, DirectionalLight]


def test_every_shape_has_its_name() -> None:
    assert tuple(SHAPES) == SHAPE_NAMES


def test_nothing_given_is_the_default(tmp_path: Path) -> None:
    assert read_scene(write(tmp_path / "scene.yaml", "")) == SceneConfig()


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("light: studio", "unknown setting light; did you mean lights?"),
        ("shape: cube", "shape is 'cube'; expected one of sphere, plane"),
        ("lights: [moon]", "moon is no light"),
        ("lights: []", "lights is empty"),
        ("camera: fisheye", "is no camera"),
        ("size: 0", "size is 0; expected 1 to"),
        ("[1, 2", "is not valid YAML"),
    ],
)
def test_a_bad_scene(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(ConfigError) as error:
        scene_of(read_scene(write(tmp_path / "scene.yaml", text)))
    assert message in str(error.value)


def test_no_file(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="cannot be read"):
        read_scene(tmp_path / "no.yaml")
