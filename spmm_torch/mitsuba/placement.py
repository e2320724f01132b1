"""How a texture lies on a shape: uv, and the frame in which directions are those of the texture.

Textures lie as those of `bitmap` do: row 0 at v = 0, repeated, after the transform `to_uv`. The
tangent of a material is where its texture runs right, whatever `to_uv` turns or mirrors.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ..errors import ConfigError
from .arrays import SMALLEST
from .libraries import dr, mi


@dataclass(frozen=True)
class Placement:
    """The transform `to_uv`.

    Attributes:
        linear: `[2, 2]`.
        shift: `[2]`.
    """

    linear: np.ndarray
    shift: np.ndarray

    @classmethod
    def of(cls, properties: Any) -> Placement:
        """The transform that the properties of a plug-in have, or none.

        Raises:
            ConfigError: it takes the texture to a line or a point.
        """
        if "to_uv" not in properties:
            return cls(np.eye(2), np.zeros(2))
        matrix = np.array(properties["to_uv"].matrix, dtype=np.float64)
        if not abs(np.linalg.det(matrix[:2, :2])) > 0.0:
            raise ConfigError(
                f"to_uv takes uv to {matrix[:2, :2].tolist()} times uv, which is no area; expected "
                f"a matrix that has an inverse; check its scales."
            )
        return cls(matrix[:2, :2], matrix[:2, 3])

    def uv(self, si: Any) -> Any:
        """uv of the texture, v up."""
        (a, b), (c, d) = self.linear.tolist()
        x, y = self.shift.tolist()
        u = a * si.uv.x + b * si.uv.y + x
        return mi.Point2f(u, 1.0 - (c * si.uv.x + d * si.uv.y + y))

    def frame(self, si: Any) -> Frame:
        """The frame of the texture at a point of a shape."""
        (a, b), (c, d) = self.linear.tolist()
        across, along = si.to_local(si.dp_du), si.to_local(si.dp_dv)
        given = dr.squared_norm(si.dp_du) > 0.0
        # The direction in which u of the texture runs and its v stays, and the one of rising v.
        determinant = a * d - b * c
        sign = 1.0 if determinant >= 0.0 else -1.0
        x = (d * across.x - c * along.x) * sign
        y = (d * across.y - c * along.y) * sign
        turned = (across.x * along.y - across.y * along.x) * -determinant
        length = dr.rsqrt(dr.maximum(x * x + y * y, SMALLEST))
        side = dr.select(turned >= 0.0, 1.0, -1.0)
        # Without a parametrization, the shading frame is that of the texture.
        parts = ((x * length, 1.0), (y * length, 0.0), (side, 1.0))
        return Frame(*(dr.select(given, part, other) for part, other in parts))


@dataclass(frozen=True)
class Frame:
    """A turn of the tangent plane, and whether the texture is seen from its back.

    Attributes:
        x, y: the tangent of the texture in the shading frame.
        side: -1 where the texture is mirrored, else 1.
    """

    x: Any
    y: Any
    side: Any

    def local(self, w: Any) -> Any:
        """A direction of the shading frame in that of the texture."""
        return mi.Vector3f(
            self.x * w.x + self.y * w.y, self.side * (self.x * w.y - self.y * w.x), w.z
        )

    def shading(self, w: Any) -> Any:
        """The inverse of `local`."""
        aside = self.side * w.y
        return mi.Vector3f(self.x * w.x - self.y * aside, self.y * w.x + self.x * aside, w.z)
