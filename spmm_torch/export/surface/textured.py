"""A surface whose parameters are textures, evaluated as a renderer does."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import torch
from torch import Tensor

from ...geometry.directions import REPEAT, texel_at
from ...geometry.relief import HeightField
from ...geometry.shapes import broadcast_shape
from .parameters import Surface


@dataclass(frozen=True)
class Textured:
    """A material: textures are interpolated, then the surface is evaluated.

    Attributes:
        surface: the parametrization.
        textures: parameters by name, as they are once decoded, `[T, n]` each.
        height, width: texels, H and W.
        rule: how the texture continues beyond its border.
        field: heights that displace the surface; None: it is flat.
        gain: how much brighter than its surface the material is.
    """

    surface: Surface
    textures: Mapping[str, Tensor]
    height: int
    width: int
    rule: str = REPEAT
    field: HeightField | None = None
    gain: float = 1.0

    @torch.no_grad()
    def __call__(self, uv: Tensor, wi: Tensor, wo: Tensor, /) -> Tensor:
        """Cosine-weighted RGB `[..., 3]` of uv `[..., 2]`, wi and wo `[..., 3]`."""
        shape = broadcast_shape(uv.shape[:-1], wi.shape[:-1], wo.shape[:-1])
        uv, wi, wo = (x.expand(*shape, n).reshape(-1, n) for x, n in ((uv, 2), (wi, 3), (wo, 3)))
        at = uv if self.field is None else self.field.hit(uv, wo)
        index, weight = texel_at(at, self.height, self.width, self.rule)
        names = tuple(self.textures)
        planes = torch.cat([self.textures[name] for name in names], dim=1)  # [T, P]
        mixed = (planes[index] * weight[..., None]).sum(1)
        columns = mixed.split([self.textures[name].shape[1] for name in names], dim=1)
        values = dict(zip(names, columns, strict=True))
        value = self.surface.eval(values, wi[..., None], wo[..., None])
        return self.gain * value.view(*shape, 3)
