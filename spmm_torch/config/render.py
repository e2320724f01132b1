"""Settings of a rendering: its sampling, its scene as text, and the suffix of its picture.

They need no torch, so that help texts are quick. `spmm_torch.render` builds the scene.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from ..errors import ConfigError
from .schema import MAX_SEED, check_settings, setting

# A picture of 4096 x 4096 pixels takes about 500 MB.
MAX_COUNT = 1 << 12
STILL_SUFFIXES = (".png", ".exr")
MOVING_SUFFIX = ".gif"
SHAPE_NAMES = ("sphere", "plane")
LIGHT_FORMS = "studio, directional:THETA,PHI[,R,G,B], point:X,Y,Z[,R,G,B], or a file (.exr, .hdr)"
CAMERA_FORMS = "orthographic[:THETA,PHI] or perspective[:THETA,PHI[,DISTANCE[,FIELD_OF_VIEW]]]"


@dataclass(frozen=True)
class RenderSettings:
    """Size and sampling of a picture.

    Raises:
        ConfigError: a value out of its range.
    """

    size: int = setting(256, "width and height of a picture in pixels", low=1, high=MAX_COUNT)
    samples: int = setting(4, "eye rays through each pixel", low=1, high=MAX_COUNT)
    light_samples: int = setting(
        4,
        "directions of each environment for each eye ray; sampled: and as many of the material",
        low=1,
        high=MAX_COUNT,
    )
    seed: int = setting(0, "seed of every random choice", low=0, high=MAX_SEED)
    lighting: str = setting(
        "auto",
        "light of environments: fixed (the same directions for all pixels, without noise), sampled "
        "(random directions of light and material, for narrow highlights), or auto (sampled for "
        "models with narrow lobes)",
        choices=("auto", "fixed", "sampled"),
    )

    def __post_init__(self) -> None:
        check_settings(self)


@dataclass(frozen=True)
class SceneConfig(RenderSettings):
    """Scene, size and sampling of a picture; angles in degrees, THETA from +z.

    Raises:
        ConfigError: a value out of its range.
    """

    shape: str = setting("sphere", "shape that the material lies on", choices=SHAPE_NAMES)
    repeat: float = setting(2.0, "copies of the texture across the shape", low=1e-3, high=1e3)
    camera: str = setting("orthographic", f"camera: {CAMERA_FORMS}; angles in degrees from +z")
    lights: tuple[str, ...] = setting(
        ("studio",), f"light: {LIGHT_FORMS}; angles in degrees from +z"
    )

    @property
    def settings(self) -> RenderSettings:
        """Size and sampling of the pictures, without the scene."""
        return RenderSettings(self.size, self.samples, self.light_samples, self.seed, self.lighting)


def check_output(path: str, moving: bool) -> None:
    """Checks the suffix of a picture's name before any work is done.

    Raises:
        ConfigError: the suffix is not one of a still, or of a moving picture.
    """
    suffix = Path(path).suffix.lower()
    if moving and suffix != MOVING_SUFFIX:
        raise ConfigError(f"output {path} is no .gif; a turntable expects one; change the name.")
    if not moving and suffix not in STILL_SUFFIXES:
        hint = "; give --turntable N for a .gif" if suffix == MOVING_SUFFIX else ""
        raise ConfigError(f"output {path} is no picture; expected .png or .exr{hint}.")
