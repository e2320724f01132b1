"""Lights and cameras from the words of a command line."""

from __future__ import annotations

import math
from pathlib import Path

import torch

from ..config.render import CAMERA_FORMS, LIGHT_FORMS
from ..data.codecs import CODECS
from ..errors import ConfigError
from ..geometry.directions import direction_from_angles
from .camera import Camera
from .environment import EnvironmentLight
from .lights import WHITE, DirectionalLight, PointLight
from .renderer import Light

MAP_SUFFIXES = tuple(suffix for codec in CODECS if codec.HDR for suffix in codec.SUFFIXES)
# How many numbers each kind may have after its colon.
LIGHT_COUNTS = {"directional": (2, 5), "point": (3, 6)}
CAMERA_COUNTS = {"orthographic": (0, 2), "perspective": (0, 2, 3, 4)}


def parse_light(text: str) -> Light:
    """The light of one `--light`; angles in degrees.

    Raises:
        ConfigError: no such light, or a number out of its range.
        DataError: the environment map cannot be used.
    """
    kind, _, rest = text.partition(":")
    if text == "studio":
        return EnvironmentLight.studio()
    if kind in LIGHT_COUNTS:
        numbers = _numbers(f"--light {text}", rest, LIGHT_COUNTS[kind], LIGHT_FORMS)
        if kind == "point":
            return PointLight.build(numbers[:3], numbers[3:] or WHITE)
        theta, phi = torch.deg2rad(torch.tensor(numbers[:2], dtype=torch.float64))
        direction = direction_from_angles(theta, phi).tolist()
        return DirectionalLight.build(direction, numbers[2:] or WHITE)
    if Path(text).suffix.lower() in MAP_SUFFIXES or Path(text).is_file():
        return EnvironmentLight.read(text)
    raise ConfigError(f"--light {text or repr(text)} is no light; expected {LIGHT_FORMS}.")


def parse_camera(text: str) -> Camera:
    """The camera of `--camera`; angles in degrees.

    Raises:
        ConfigError: no such camera, or a number out of its range.
    """
    kind, _, rest = text.partition(":")
    if kind not in CAMERA_COUNTS:
        raise ConfigError(f"--camera {text!r} is no camera; expected {CAMERA_FORMS}.")
    numbers = _numbers(f"--camera {text}", rest, CAMERA_COUNTS[kind], CAMERA_FORMS)
    angles = [math.radians(x) for x in numbers[:2]]
    if kind == "orthographic":
        return Camera.orthographic(*angles)
    field_of_view = [math.radians(x) for x in numbers[3:]]
    return Camera.perspective(*angles, *numbers[2:3], *field_of_view)


def parse_exposure(text: str) -> float | None:
    """The factor of `--exposure`; None for `auto`.

    Raises:
        ConfigError: the text is neither `auto` nor a positive number.
    """
    if text == "auto":
        return None
    factor = _number(text)
    if factor is None or factor <= 0.0:
        raise ConfigError(f"--exposure is {text!r}; expected auto or a positive factor.")
    return factor


def _numbers(option: str, text: str, counts: tuple[int, ...], forms: str) -> list[float]:
    words = text.split(",") if text else []
    numbers = [_number(word) for word in words]
    if len(words) not in counts or None in numbers:
        raise ConfigError(f"{option} is malformed; expected {forms}.")
    return [number for number in numbers if number is not None]


def _number(word: str) -> float | None:
    """A finite number, or None."""
    try:
        number = float(word)
    except ValueError:
        return None
    return number if math.isfinite(number) else None
