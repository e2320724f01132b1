"""Lights with one direction at each point, and the checks of all lights."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from ..errors import ConfigError

WHITE = (1.0, 1.0, 1.0)


@dataclass(frozen=True)
class DirectionalLight:
    """Parallel light.

    Attributes:
        direction: unit, towards the light, `[3]` float64.
        irradiance: RGB on a surface that faces the light, `[3]` float64; under irradiance 1, a
            picture shows the cosine-weighted reflectance itself.
    """

    direction: Tensor
    irradiance: Tensor

    @classmethod
    def build(
        cls, direction: Sequence[float], irradiance: Sequence[float] = WHITE
    ) -> DirectionalLight:
        """A light from a direction of any length.

        Raises:
            ConfigError: the direction is 0 or not finite, or the irradiance negative or black.
        """
        towards = _vector("direction of a directional light", direction)
        length = towards.norm()
        if length == 0.0:
            raise ConfigError("direction of a directional light is 0, 0, 0; expected a direction.")
        return cls(towards / length, checked_rgb("irradiance of a directional light", irradiance))

    def at(self, position: Tensor) -> tuple[Tensor, Tensor]:
        """Directions to the light and irradiance facing it, both `[N, 3]`, at points `[N, 3]`."""
        direction = self.direction.to(position).expand_as(position)
        return direction, self.irradiance.to(position).expand_as(position)

    def rotated(self, rotation: Tensor) -> DirectionalLight:
        """The light turned by a rotation `[3, 3]` of the world about the origin."""
        return replace(self, direction=rotation @ self.direction)


@dataclass(frozen=True)
class PointLight:
    """A light at one point.

    Attributes:
        position: in world axes, `[3]` float64.
        intensity: RGB; irradiance facing the light at distance r is intensity / r^2, `[3]` float64.
    """

    position: Tensor
    intensity: Tensor

    @classmethod
    def build(cls, position: Sequence[float], intensity: Sequence[float] = WHITE) -> PointLight:
        """A light at a position.

        Raises:
            ConfigError: the position is not finite, or the intensity negative or black.
        """
        return cls(
            _vector("position of a point light", position),
            checked_rgb("intensity of a point light", intensity),
        )

    def at(self, position: Tensor) -> tuple[Tensor, Tensor]:
        """Directions to the light and irradiance facing it, both `[N, 3]`, at points `[N, 3]`."""
        offset = self.position.to(position) - position
        squared = (offset * offset).sum(-1, keepdim=True)
        return offset * torch.rsqrt(squared), self.intensity.to(position) / squared

    def rotated(self, rotation: Tensor) -> PointLight:
        """The light turned by a rotation `[3, 3]` of the world about the origin."""
        return replace(self, position=rotation @ self.position)


def checked_rgb(name: str, rgb: Sequence[float]) -> Tensor:
    """RGB `[3]` float64 that is finite, not negative, and not black.

    Raises:
        ConfigError: the values are not.
    """
    value = _vector(name, rgb)
    if bool((value < 0.0).any()):
        raise ConfigError(f"{name} is {list(rgb)}; expected red, green and blue not below 0.")
    if not bool(value.any()):
        raise ConfigError(f"{name} is black; expected a light that lights something.")
    return value


def _vector(name: str, numbers: Sequence[float]) -> Tensor:
    value = torch.tensor(list(numbers), dtype=torch.float64)
    if value.shape != (3,) or not bool(value.isfinite().all()):
        raise ConfigError(f"{name} is {list(numbers)}; expected three finite numbers.")
    return value
