"""The camera: parallel or perspective rays towards the origin; pictures are square."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from ..errors import ConfigError
from ..geometry.directions import direction_from_angles
from .shapes import Rays

# Half of the width that a parallel camera shows: the unit sphere with a narrow margin.
HALF_WIDTH = 1.05
# Parallel rays start this far from the origin, outside of every shape.
START = 4.0
# A perspective camera that shows the sphere with a narrow margin, too.
DISTANCE = 4.0
FIELD_OF_VIEW = math.radians(30.0)
UP = (0.0, 1.0, 0.0)
# Up in the picture where the camera looks along UP, to within this sine.
OTHER_UP = (0.0, 0.0, -1.0)
PARALLEL_SINE = 1e-6


@dataclass(frozen=True)
class Camera:
    """A camera that looks at the origin.

    Attributes:
        axes: rows are right, up and back (towards the camera) in world axes, `[3, 3]` float64.
        half_width: half of the width of the picture, in the plane of the origin.
        distance: from the origin; None for parallel rays.
    """

    axes: Tensor
    half_width: float
    distance: float | None

    @classmethod
    def orthographic(
        cls, theta: float = 0.0, phi: float = 0.0, half_width: float = HALF_WIDTH
    ) -> Camera:
        """A camera of parallel rays in direction (theta, phi), radians; theta from +z.

        Raises:
            ConfigError: a value out of its range.
        """
        _check_positive("half width of the camera", half_width)
        return cls(_axes(theta, phi), half_width, None)

    @classmethod
    def perspective(
        cls,
        theta: float = 0.0,
        phi: float = 0.0,
        distance: float = DISTANCE,
        field_of_view: float = FIELD_OF_VIEW,
    ) -> Camera:
        """A pinhole camera at `distance` from the origin; the field of view is the full angle.

        Raises:
            ConfigError: a value out of its range.
        """
        _check_positive("distance of the camera", distance)
        if not 0.0 < field_of_view < math.pi:
            raise ConfigError(
                f"field of view is {math.degrees(field_of_view):g} degrees; expected a value "
                f"between 0 and 180."
            )
        half_width = distance * math.tan(0.5 * field_of_view)
        return cls(_axes(theta, phi), half_width, distance)

    @property
    def position(self) -> Tensor | None:
        """The pinhole `[3]`; None for parallel rays."""
        return None if self.distance is None else self.distance * self.axes[2]

    def rotated(self, rotation: Tensor) -> Camera:
        """The camera turned by a rotation `[3, 3]` of the world about the origin."""
        return replace(self, axes=self.axes @ rotation.T)

    def rays(self, at: Tensor) -> Rays:
        """Rays through points `[R, 2]` of the picture, which spans 0 to 1 rightwards and up."""
        axes = self.axes.to(at)
        shift = (2.0 * at - 1.0) * self.half_width
        target = shift @ axes[:2]  # [R, 3], in the plane of the origin
        if self.distance is None:
            return Rays(target + START * axes[2], (-axes[2]).expand_as(target))
        origin = self.distance * axes[2]
        direction = target - origin
        return Rays(origin.expand_as(target), direction / direction.norm(dim=-1, keepdim=True))


def turn(axis: tuple[float, float, float], angle: float) -> Tensor:
    """The rotation `[3, 3]` float64 about a unit axis by an angle in radians [Rodrigues 1840]."""
    x, y, z = axis
    cross = torch.tensor([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]], dtype=torch.float64)
    eye = torch.eye(3, dtype=torch.float64)
    return eye + math.sin(angle) * cross + (1.0 - math.cos(angle)) * (cross @ cross)


def _axes(theta: float, phi: float) -> Tensor:
    """Right, up and back `[3, 3]` of a camera in direction (theta, phi)."""
    if not (math.isfinite(theta) and math.isfinite(phi)):
        raise ConfigError(
            f"camera direction is ({theta}, {phi}); expected two finite angles, theta and phi."
        )
    angles = torch.tensor([theta, phi], dtype=torch.float64)
    back = direction_from_angles(angles[0], angles[1])
    right = torch.linalg.cross(torch.tensor(UP, dtype=torch.float64), back)
    if right.norm() < PARALLEL_SINE:
        right = torch.linalg.cross(torch.tensor(OTHER_UP, dtype=torch.float64), back)
    right = right / right.norm()
    return torch.stack((right, torch.linalg.cross(back, right), back))


def _check_positive(name: str, value: float) -> None:
    if not (math.isfinite(value) and value > 0.0):
        raise ConfigError(f"{name} is {value}; expected a positive number.")
