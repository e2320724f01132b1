"""A BTF as a material: its own values, interpolated between measured directions and texels."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from ..data import BTF
from ..geometry.directions import REPEAT, texel_at
from ..geometry.grazing import grazing_fade, lowest_cosine
from ..geometry.hemisphere import HemisphereInterpolation
from ..geometry.shapes import broadcast_shape
from ..runtime.memory import slices

# Values of whole texels that are decoded at once: 64 MB of float32.
TEXEL_VALUES = 1 << 24
# Values that are picked out of these at once, 27 for each (query, texel).
PICKED_VALUES = 1 << 22


@dataclass(frozen=True)
class BTFMaterial:
    """A BTF between its measured directions and texels.

    Linear between the corners of the spherical triangles of lights and of views (3 x 3 pairs) and
    bilinear between texels: measured pairs at texel centres return their measured value. Below
    the lowest measured ring, values are those of the ring; for lights they fade with the cosine.
    The residual of a model follows the same rules.

    Attributes:
        btf: decoded in memory or in its cache.
        light_mesh, view_mesh: meshes of its directions.
        rule: how the texture continues beyond its border; see `directions.RULES`.
        texel_values: values of the texels that are read at once.
        picked_values: values of those that are picked at once.
    """

    btf: BTF
    light_mesh: HemisphereInterpolation
    view_mesh: HemisphereInterpolation
    rule: str = REPEAT
    texel_values: int = TEXEL_VALUES
    picked_values: int = PICKED_VALUES

    @classmethod
    def build(cls, btf: BTF, device: torch.device | str = "cpu", rule: str = REPEAT) -> BTFMaterial:
        """The material of a BTF that continues by a rule, evaluated on a device."""
        light = HemisphereInterpolation.build(btf.light).to(device)
        return cls(btf, light, HemisphereInterpolation.build(btf.view).to(device), rule)

    def __call__(self, uv: Tensor, wi: Tensor, wo: Tensor, /) -> Tensor:
        """Linear cosine-weighted RGB `[..., C]` of uv `[..., 2]`, wi and wo `[..., 3]`.

        Memory is bounded whatever the size of the BTF; each texel is read once.
        """
        shape = broadcast_shape(uv.shape[:-1], wi.shape[:-1], wo.shape[:-1])
        flat = uv.expand(*shape, 2).reshape(-1, 2)
        texel, texel_weight = texel_at(flat, self.btf.height, self.btf.width, self.rule)  # [Q, 4]
        pair, weight = self.pairs_at(wi, wo, shape)  # [Q, 9]
        query, corner = torch.nonzero(texel_weight, as_tuple=True)  # [E]
        order = torch.argsort(texel[query, corner], stable=True)
        query, corner = query[order], corner[order]
        entries = texel_weight.new_zeros(*texel_weight.shape, self.btf.channels)  # [Q, 4, C]
        met, count = torch.unique_consecutive(texel[query, corner], return_counts=True)
        end = count.cumsum(0).tolist()
        for block in slices(len(met), max(1, self.texel_values // (self.btf.pair_count * 3))):
            values = self.btf.texels(met[block], uv.device).flatten(0, 1)  # [n * D, C]
            first = end[block.start - 1] if block.start else 0
            row = torch.repeat_interleave(count[block])  # [e], texel of the block
            for part in slices(len(row), max(1, self.picked_values // 27)):
                where = slice(first + part.start, first + part.stop)
                q = query[where]
                picked = values[row[part, None] * self.btf.pair_count + pair[q]].to(weight)
                entries[q, corner[where]] = torch.einsum("epc,ep->ec", picked, weight[q])
            del values  # before the next block is read: two of them need twice the memory
        total = (entries * texel_weight[..., None]).sum(1)
        return total.view(*shape, self.btf.channels)

    def pairs_at(self, wi: Tensor, wo: Tensor, shape: torch.Size) -> tuple[Tensor, Tensor]:
        """Direction pairs and weights `[Q, 9]` of wi and wo `[..., 3]`, which broadcast to `shape`.

        Missing pairs have weight 0; their measured neighbours take it over.
        """
        light, light_weight = self.light_mesh.weights(wi)  # [..., 3]
        view, view_weight = self.view_mesh.weights(wo)  # [..., 3]
        fade = grazing_fade(wi[..., 2], lowest_cosine(self.btf.light))
        light_weight = light_weight * fade[..., None]
        view_weight = view_weight * (wo[..., 2:] > 0.0)
        pair = view[..., :, None] * len(self.btf.light) + light[..., None, :]
        weight = view_weight[..., :, None] * light_weight[..., None, :]
        full = (*shape, 3, 3)
        pair, weight = pair.expand(full).reshape(-1, 9), weight.expand(full).reshape(-1, 9)
        return pair, self._measured_only(pair, weight)

    def _measured_only(self, pair: Tensor, weight: Tensor) -> Tensor:
        """Weights `[Q, 9]` of equal sums that are 0 for missing pairs."""
        if self.btf.measured is None:
            return weight
        kept = weight * self.btf.measured.to(weight.device)[pair]
        tiny = torch.finfo(weight.dtype).tiny
        return kept * (weight.sum(1, keepdim=True) / kept.sum(1, keepdim=True).clamp(min=tiny))
