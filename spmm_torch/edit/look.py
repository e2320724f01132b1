"""A sample of the colours that a model shows."""

from __future__ import annotations

import torch
from torch import Tensor

from ..model import SPMM
from ..warp import square_to_uniform_hemisphere
from .selection import Selection

TEXELS, PAIRS = 512, 32
SEED = 0


def look_colours(
    model: SPMM, where: Selection | None = None, lobes: Tensor | None = None
) -> Tensor:
    """Colours `[N, 3]` of random texels under random lights and views, none below 0.

    Brighter ones are longer, so least squares heeds them more, as it does in a picture.

    Args:
        where: colours are multiplied by its shares; None for the whole texture.
        lobes: `[J]` bool, only these lobes, without residual; None for all.
    """
    generator = torch.Generator().manual_seed(SEED)
    u = torch.rand(2, PAIRS, 2, generator=generator)
    wi, wo = square_to_uniform_hemisphere(u).to(model.weight)  # [P, 3]
    texel = _chosen(model, where, generator)  # [n]
    count = model.lobe_count_per_texel()[texel]
    row = torch.repeat_interleave(count)  # [E]
    within = torch.arange(len(row), device=row.device) - (count.cumsum(0) - count)[row]
    entry = model.offset[texel][row] + within
    weight = model.weight[entry]
    if where is not None:
        weight = weight * where.entries[entry][:, None]
    rho = model.dictionary.detach().eval(wi[None], wo[None])  # [J, P]
    if lobes is not None:
        rho = rho * lobes[:, None]
    value = rho[model.index[entry]][:, :, None] * weight[:, None]  # [E, P, 3]
    total = value.new_zeros(len(texel), PAIRS, value.shape[2]).index_add(0, row, value)
    if lobes is None and (where is None or where.texels is not None):
        total = total + _residual(model, texel, wi, wo, where)
    return total.clamp(min=0.0).flatten(0, 1)


def _chosen(model: SPMM, where: Selection | None, generator: torch.Generator) -> Tensor:
    """Random texels among those that are selected at all."""
    offset = model.offset
    if where is None:
        candidates = torch.arange(model.texel_count)
    else:
        reach = torch.cat((where.entries.new_zeros(1), where.entries)).double().cumsum(0)
        candidates = torch.nonzero(reach[offset[1:]] > reach[offset[:-1]]).squeeze(-1).cpu()
    order = torch.randint(max(1, len(candidates)), (TEXELS,), generator=generator)
    chosen = candidates[order] if len(candidates) else torch.zeros(0, dtype=torch.long)
    return chosen.to(offset.device)


def _residual(
    model: SPMM, texel: Tensor, wi: Tensor, wo: Tensor, where: Selection | None
) -> Tensor:
    """The residual `[n, P, 3]` of texels under pairs of directions `[P, 3]`."""
    pair = (model.cluster_count, len(wi))
    cluster = torch.arange(pair[0], device=wi.device)[:, None].expand(pair)
    value = model.residual(cluster, wi.expand(*pair, 3), wo.expand(*pair, 3))  # [K, P, 3]
    value = value[model.labels[texel]]
    return value if where is None else value * where.texels[texel][:, None, None]
