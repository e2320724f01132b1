"""A sample of what a model shows: the colours that an edit of colours has to change well."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from ..model.spmm import SPMM
from .selection import Selection

# Texels that are looked at, and measured pairs of directions that they share.
TEXELS, PAIRS = 256, 128
# Each texel is seen under so many pairs, and their mean counts: a pixel of a picture mixes several
# points, lights and directions too, so it is never as colourful as the extremes of one texel.
MIXED = 16
SEED = 0


@dataclass(frozen=True)
class Look:
    """What random texels show on average under a few measured lights and views.

    Attributes:
        colour: `[n, C]`, none below 0. Brighter ones are longer, so least squares heeds them more,
            as it does in a picture.
        reflection: mean of rho of each lobe over the pairs, `[J]`.
    """

    colour: Tensor
    reflection: Tensor


def sample_look(model: SPMM, where: Selection | None = None, lobes: Tensor | None = None) -> Look:
    """Looks at random texels; views are as frequent as their projected area, lights are even.

    Args:
        where: colours are multiplied by its shares; None for the whole texture.
        lobes: `[J]` bool, only these lobes, without residual; None for all.
    """
    generator = torch.Generator().manual_seed(SEED)
    light = torch.randint(len(model.light), (PAIRS,), generator=generator)
    seen = model.view[:, 2].cpu().clamp(min=0.0)
    view = torch.multinomial(seen, PAIRS, replacement=True, generator=generator)
    texel = _chosen(model, where, generator).repeat_interleave(MIXED)  # [n MIXED]
    pair = torch.arange(len(texel), device=texel.device) % PAIRS
    rho = _reflected(model, light, view)  # [J, P]
    count = model.lobe_count_per_texel()[texel]
    row = torch.repeat_interleave(count)  # [E]
    within = torch.arange(len(row), device=row.device) - (count.cumsum(0) - count)[row]
    entry = model.offset[texel][row] + within
    lobe = model.index[entry]
    shown = rho[lobe, pair[row]]
    shown = shown if lobes is None else shown * lobes[lobe]
    shown = shown if where is None else shown * where.entries[entry]
    value = model.weight[entry] * shown[:, None]  # [E, C]
    colour = value.new_zeros(len(texel), value.shape[1]).index_add(0, row, value)
    if lobes is None and (where is None or where.texels is not None):
        cluster = model.labels[texel]
        code = model.residual.code[cluster, view.to(cluster)[pair], light.to(cluster)[pair]]
        epsilon = code.to(colour) * model.residual.scale[cluster, None]
        colour = colour + (epsilon if where is None else epsilon * where.texels[texel, None])
    colour = colour.unflatten(0, (-1, MIXED)).mean(1) if len(texel) else colour
    return Look(colour.clamp(min=0.0), rho.mean(1))


def _reflected(model: SPMM, light: Tensor, view: Tensor) -> Tensor:
    """rho of all lobes under pairs of measured directions, by indices `[P]`: `[J, P]`."""
    wi, wo = model.light[light.to(model.light.device)], model.view[view.to(model.view.device)]
    return model.dictionary.detach().eval(wi[None], wo[None])


def _chosen(model: SPMM, where: Selection | None, generator: torch.Generator) -> Tensor:
    """Random texels `[n]` among those that are selected at all; none if there are none."""
    candidates = torch.arange(model.texel_count)
    if where is not None:
        reach = torch.cat((where.entries.new_zeros(1), where.entries)).double().cumsum(0)
        touched = reach[model.offset[1:]] > reach[model.offset[:-1]]
        candidates = torch.nonzero(touched).squeeze(-1).cpu()
    number = TEXELS if len(candidates) else 0
    order = torch.randint(max(1, len(candidates)), (number,), generator=generator)
    return candidates[order].to(model.offset.device)
