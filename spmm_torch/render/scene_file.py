"""A scene as a YAML file: shape, camera and lights in the words of `spmm render`, and its size.

shape: sphere
repeat: 2.0
camera: orthographic:20,0
lights: [studio, "directional:45,90"]
size: 256
"""

from __future__ import annotations

from pathlib import Path

from ..config.render import SceneConfig
from ..config.schema import from_dict
from ..config.written import read_yaml
from .options import parse_camera, parse_light
from .renderer import Scene
from .shapes import SHAPES, Texture


def scene_of(config: SceneConfig, aspect: float = 1.0) -> Scene:
    """The scene that settings describe, for a texture of `aspect` = width over height.

    Raises:
        ConfigError: a camera or light is unknown, or the camera lies inside the shape.
        DataError: an environment map cannot be used.
    """
    shape = SHAPES[config.shape](Texture(config.repeat, aspect))
    lights = tuple(parse_light(text) for text in config.lights)
    return Scene(shape, parse_camera(config.camera), lights)


def read_scene(path: Path | str) -> SceneConfig:
    """The settings of a scene in a YAML file.

    Raises:
        ConfigError: the file cannot be read, is not YAML, or has a wrong key or value.
    """
    return from_dict(SceneConfig, read_yaml(path))
