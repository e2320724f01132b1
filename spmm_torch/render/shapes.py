"""The shapes that show a material, both around the origin, from -1 to 1.

World axes: x right, y up, z towards a camera in front. In the middle of either shape the local
frame (tangent, bitangent, normal) is (x, y, z): pictures show textures upright.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import torch
from torch import Tensor

from ..errors import ConfigError

# Least squared radius under a root; float32 does not tell 1 from 1 plus this.
LEAST_SQUARED_RADIUS = 1e-12


@dataclass(frozen=True)
class Rays:
    """R rays: origins and unit directions, both `[R, 3]`."""

    origin: Tensor
    direction: Tensor


@dataclass(frozen=True)
class Texture:
    """How a texture lies on a shape.

    Attributes:
        repeat: copies across a plane, or along half a turn of a sphere.
        aspect: width over height of the texture; its texels stay square.

    Raises:
        ConfigError: a value is not positive.
    """

    repeat: float = 1.0
    aspect: float = 1.0

    def __post_init__(self) -> None:
        for name, value in (("repeat", self.repeat), ("aspect", self.aspect)):
            if not (math.isfinite(value) and value > 0.0):
                raise ConfigError(f"texture {name} is {value}; expected a positive number.")

    def at(self, across: Tensor, up: Tensor) -> Tensor:
        """uv `[..., 2]` of distances `[...]` from the middle, in widths of the shape.

        One copy lies in the middle, so that no seam does.
        """
        u, v = self.repeat * across, self.repeat * self.aspect * up
        return torch.stack((u, v), dim=-1) + 0.5


@dataclass(frozen=True)
class Sphere:
    """The unit sphere; u runs along the longitude, v along the latitude, its poles are +-y."""

    texture: Texture = Texture()
    axis = (0.0, 1.0, 0.0)  # of a turntable

    def distance(self, rays: Rays) -> Tensor:
        """Distance `[R]` at which each ray first meets the outside; infinite where it misses."""
        along = -(rays.origin * rays.direction).sum(-1)
        nearest = rays.origin + along[:, None] * rays.direction  # of the ray to the centre
        left = 1.0 - (nearest * nearest).sum(-1)
        distance = along - torch.sqrt(left.clamp(min=0.0))
        return torch.where((left > 0.0) & (distance > 0.0), distance, torch.inf)

    def surface(self, position: Tensor) -> tuple[Tensor, Tensor]:
        """Local frames `[N, 3, 3]` (rows tangent, bitangent, normal) and uv `[N, 2]`."""
        normal = position / position.norm(dim=-1, keepdim=True)
        x, y, z = normal.unbind(-1)
        longitude = torch.atan2(x, z)
        zero = torch.zeros_like(x)
        tangent = torch.stack((torch.cos(longitude), zero, -torch.sin(longitude)), dim=-1)
        bitangent = torch.linalg.cross(normal, tangent)
        frame = torch.stack((tangent, bitangent, normal), dim=-2)
        latitude = torch.atan2(y, torch.sqrt((x * x + z * z).clamp(min=LEAST_SQUARED_RADIUS)))
        return frame, self.texture.at(longitude / math.pi, latitude / math.pi)

    def holds(self, point: Tensor) -> bool:
        """Whether a point `[3]` lies inside, or on it."""
        return bool(point.norm() <= 1.0)


@dataclass(frozen=True)
class Plane:
    """The square from -1 to 1 in x and y, seen from +z only."""

    texture: Texture = Texture()
    axis = (0.0, 0.0, 1.0)

    def distance(self, rays: Rays) -> Tensor:
        """Distance `[R]` at which each ray meets the upper side; infinite where it misses."""
        z = rays.direction[:, 2]
        faces = z < 0.0
        distance = -rays.origin[:, 2] / torch.where(faces, z, -1.0)
        position = rays.origin + distance[:, None] * rays.direction
        on = faces & (distance > 0.0) & (position[:, :2].abs() <= 1.0).all(-1)
        return torch.where(on, distance, torch.inf)

    def surface(self, position: Tensor) -> tuple[Tensor, Tensor]:
        """Local frames `[N, 3, 3]` (rows tangent, bitangent, normal) and uv `[N, 2]`."""
        frame = torch.eye(3, dtype=position.dtype, device=position.device)
        across, up = (0.5 * position[:, :2]).unbind(-1)
        return frame.expand(len(position), 3, 3), self.texture.at(across, up)

    def holds(self, point: Tensor) -> bool:
        """Whether a point `[3]` lies inside: never, for a plane."""
        return False


Shape = Sphere | Plane
# Shapes by the names in `config.render.SHAPE_NAMES`.
SHAPES: dict[str, Callable[[Texture], Shape]] = {"sphere": Sphere, "plane": Plane}
