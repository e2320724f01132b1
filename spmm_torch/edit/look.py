"""A sample of what a model shows: the colours that an edit of colours has to change well."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from ..model.spmm import SPMM
from .selection import EVERYTHING, Selection

# Random texels, and measured pairs of directions that they share.
TEXELS, PAIRS = 256, 128
# Pairs that each texel is averaged over: a pixel of a picture mixes several points, lights and
# directions too, so it is never as colourful as the extremes of one texel.
MIXED = 16
SEED = 0


@dataclass(frozen=True)
class Look:
    """What n random texels show on average under a few measured lights and views.

    Attributes:
        colour: `[n, C]`, none below 0. Bright colours are long vectors, so least squares heeds
            them most, as the eye does in a picture.
        reflection: mean of rho of each lobe over the pairs, `[J]`.
    """

    colour: Tensor
    reflection: Tensor


def sample_look(model: SPMM, where: Selection = EVERYTHING) -> Look:
    """Looks at random texels; views are as frequent as their projected area, lights are even.

    Args:
        model: what is looked at.
        where: its shares multiply the colours.
    """
    generator = torch.Generator().manual_seed(SEED)
    light = torch.randint(len(model.light), (PAIRS,), generator=generator)
    seen = model.view[:, 2].cpu().clamp(min=0.0)
    view = torch.multinomial(seen, PAIRS, replacement=True, generator=generator)
    texel = _random_texels(model, where, generator).repeat_interleave(MIXED)  # [n MIXED]
    pair = torch.arange(len(texel), device=texel.device) % PAIRS
    rho = _reflected(model, light, view)  # [J, PAIRS]
    count = model.lobe_count_per_texel()[texel]
    row = torch.repeat_interleave(count)  # [E]
    within = torch.arange(len(row), device=row.device) - (count.cumsum(0) - count)[row]
    entry = model.offset[texel][row] + within
    shown = rho[model.index[entry], pair[row]]
    share = where.entry_share(model)
    shown = shown if share is None else shown * share[entry]
    value = model.weight[entry] * shown[:, None]  # [E, C]
    colour = value.new_zeros(len(texel), value.shape[1]).index_add(0, row, value)
    if where.reaches_residual:
        epsilon = _residual(model, texel, view.to(texel)[pair], light.to(texel)[pair]).to(colour)
        share = where.texels
        colour = colour + (epsilon if share is None else epsilon * share[texel, None])
    colour = colour.unflatten(0, (-1, MIXED)).mean(1) if len(texel) else colour
    return Look(colour.clamp(min=0.0), rho.mean(1))


def _reflected(model: SPMM, light: Tensor, view: Tensor) -> Tensor:
    """rho of all lobes under pairs of measured directions, by indices `[P]`: `[J, P]`."""
    wi, wo = model.light[light.to(model.light.device)], model.view[view.to(model.view.device)]
    return model.dictionary.detach().eval(wi[None], wo[None])


def _residual(model: SPMM, texel: Tensor, view: Tensor, light: Tensor) -> Tensor:
    """The residual `[E, C]` of texels at measured views and lights, by indices, all `[E]`."""
    total = torch.zeros(len(texel), model.weight.shape[1], device=texel.device)
    if len(model.residual.code):
        cluster = model.labels[texel]
        code = model.residual.code[cluster, view, light]
        total = code.to(total) * model.residual.scale[cluster, None]
    if model.components is None:
        return total
    return total + model.components.measured(texel, view * len(model.light) + light)


def _random_texels(model: SPMM, where: Selection, generator: torch.Generator) -> Tensor:
    """Random texels `[n]` among those that the mask selects at all; none if there are none."""
    candidates = torch.arange(model.texel_count)
    if where.entries is not None:
        reach = torch.cat((where.entries.new_zeros(1), where.entries)).double().cumsum(0)
        touched = reach[model.offset[1:]] > reach[model.offset[:-1]]
        candidates = torch.nonzero(touched).squeeze(-1).cpu()
    number = TEXELS if len(candidates) else 0
    order = torch.randint(max(1, len(candidates)), (number,), generator=generator)
    return candidates[order].to(model.offset.device)
