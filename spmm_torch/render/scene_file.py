"""A scene as a YAML file: shape, camera and lights in the words of `spmm render`, and its size.

shape: sphere
repeat: 2.0
camera: orthographic:20,0
lights: [studio, "directional:45,90"]
size: 256
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from ..config.schema import from_dict, read_yaml, setting
from .options import CAMERA_FORMS, LIGHT_FORMS, parse_camera, parse_light
from .renderer import MAX_COUNT, RenderSettings, Scene
from .shapes import SHAPES, Texture


@dataclass(frozen=True)
class SceneConfig:
    """What is rendered, and how finely; angles in degrees."""

    shape: str = setting("sphere", "what the material lies on", choices=tuple(SHAPES))
    repeat: float = setting(2.0, "copies of the texture across", low=1e-3, high=1e3)
    camera: str = setting("orthographic", CAMERA_FORMS)
    lights: tuple[str, ...] = setting(("studio",), LIGHT_FORMS)
    size: int = setting(256, "pixels each way", low=1, high=MAX_COUNT)
    samples: int = setting(4, "eye rays of a pixel", low=1, high=MAX_COUNT)
    light_samples: int = setting(
        4, "directions to an environment for each eye ray", low=1, high=MAX_COUNT
    )
    seed: int = setting(0, "of every random choice", low=0)

    @property
    def settings(self) -> RenderSettings:
        """How fine its pictures are."""
        return RenderSettings(self.size, self.samples, self.light_samples, self.seed)

    def scene(self, aspect: float = 1.0) -> Scene:
        """The scene for a texture of `aspect` = width over height.

        Raises:
            ConfigError: no such camera or light, or the camera lies inside of the shape.
            DataError: an environment map cannot be used.
        """
        shape = SHAPES[self.shape](Texture(self.repeat, aspect))
        lights = tuple(parse_light(text) for text in self.lights)
        return Scene(shape, parse_camera(self.camera), lights)


def read_scene(path: Path | str) -> SceneConfig:
    """The scene of a YAML file.

    Raises:
        ConfigError: no such file, no YAML, an unknown key, or a value out of its range.
    """
    return from_dict(SceneConfig, read_yaml(path))
