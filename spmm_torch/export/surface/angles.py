"""Directions of light, view and half vector in the shading frames of texels."""

from __future__ import annotations

from dataclasses import dataclass, replace

import torch
from torch import Tensor

# Least z of a shading normal, and least cosine that values are divided by.
LEAST_NORMAL_Z, LEAST_COSINE = 0.2, 1e-3
TINY = 1e-12  # keeps the direction of a short vector, and the gradient of its length


@dataclass(frozen=True)
class Local:
    """Components of directions in the frames of texels, `[T, S]` each or as broadcasts to it."""

    x: Tensor
    y: Tensor
    z: Tensor

    @property
    def cosine(self) -> Tensor:
        """z `[T, S]`, not below what values are divided by."""
        return self.z.clamp(min=LEAST_COSINE)


@dataclass(frozen=True)
class Angles:
    """What a reflection depends on, for T texels and S pairs of directions.

    Attributes:
        i, o, h: light, view and half vector in the shading frame.
        cos_d: cosine between light and half vector, `[S]` or `[T, 1]`.
        lit: 1 where light and view are over the horizon of texel and plane, else 0, `[T, S]`.
    """

    i: Local
    o: Local
    h: Local
    cos_d: Tensor
    lit: Tensor

    @classmethod
    def build(cls, slope: Tensor, wi: Tensor, wo: Tensor) -> Angles:
        """The angles of some pairs of directions.

        Args:
            slope: x and y of the shading normals, `[T, 2]`.
            wi, wo: unit directions that all texels share, `[3, S]`, or one for each, `[T, 3, 1]`.
        """
        frame, half = shading_frames(slope), half_vectors(wi, wo)
        i, o, h = (Local(*(frame @ w).unbind(1)) for w in (wi, wo, half))
        over = (i.z > 0.0) & (o.z > 0.0) & (wi[..., 2, :] > 0.0) & (wo[..., 2, :] > 0.0)
        cos_d = (wi * half).sum(-2).clamp(0.0, 1.0)
        return cls(i, o, h, cos_d, over.to(i.z.dtype))

    def along_plane(self, wi: Tensor, wo: Tensor) -> Angles:
        """The same directions, their x and y those in the plane of the texture.

        Args:
            wi, wo: see `build`, `[3, S]` or `[T, 3, 1]`.
        """
        i, o, h = (
            replace(local, x=w[..., 0, :], y=w[..., 1, :])
            for local, w in ((self.i, wi), (self.o, wo), (self.h, half_vectors(wi, wo)))
        )
        return replace(self, i=i, o=o, h=h)


def half_vectors(wi: Tensor, wo: Tensor) -> Tensor:
    """Unit half vectors, in the shape of wi and wo, `[..., 3, S]`."""
    half = wi + wo
    return half / half.square().sum(-2, keepdim=True).clamp(min=TINY).sqrt()


def shading_frames(slope: Tensor) -> Tensor:
    """Frames `[T, 3, 3]`, rows tangent, bitangent and normal, of normals' x and y `[T, 2]`.

    The tangent is that of the texture, made orthogonal to the normal, as renderers do.
    """
    x, y = slope.unbind(-1)
    z = (1.0 - x * x - y * y).clamp(min=LEAST_NORMAL_Z**2).sqrt()
    normal = torch.stack((x, y, z), dim=-1)
    normal = normal / normal.square().sum(-1, keepdim=True).sqrt()
    tangent = torch.stack((1.0 - x * x, -x * y, -x * z), dim=-1)
    tangent = tangent / tangent.square().sum(-1, keepdim=True).sqrt()
    bitangent = torch.linalg.cross(normal, tangent)
    return torch.stack((tangent, bitangent, normal), dim=1)
