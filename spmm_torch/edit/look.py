"""A sample of what a model shows: the colours that an edit of colours has to change well."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from ..model import SPMM
from ..warp import square_to_cosine_hemisphere, square_to_uniform_hemisphere
from .selection import Selection

SAMPLES = 4096
SEED = 0


@dataclass(frozen=True)
class Look:
    """What random texels show, each under one light and one view.

    Attributes:
        colour: `[n, C]`, none below 0. Brighter ones are longer, so least squares heeds them more,
            as it does in a picture.
        reflection: mean of rho of each lobe, `[J]`; of all lobes where none of it was met.
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
    texel = _chosen(model, where, generator)  # [n]
    u = torch.rand(2, len(texel), 2, generator=generator).to(model.weight)
    wi, wo = square_to_uniform_hemisphere(u[0]), square_to_cosine_hemisphere(u[1])
    count = model.lobe_count_per_texel()[texel]
    row = torch.repeat_interleave(count)  # [E]
    within = torch.arange(len(row), device=row.device) - (count.cumsum(0) - count)[row]
    entry = model.offset[texel][row] + within
    lobe, share = model.index[entry], None if where is None else where.entries[entry]
    rho = model.dictionary.detach()[lobe].eval(wi[row, None], wo[row, None])[:, 0]  # [E]
    shown = rho if lobes is None else rho * lobes[lobe]
    shown = shown if share is None else shown * share
    value = model.weight[entry] * shown[:, None]  # [E, C]
    colour = value.new_zeros(len(texel), value.shape[1]).index_add(0, row, value)
    if lobes is None and (where is None or where.texels is not None):
        epsilon = model.residual(model.labels[texel], wi, wo)
        colour = colour + (epsilon if where is None else epsilon * where.texels[texel, None])
    return Look(colour.clamp(min=0.0), _means(rho, lobe, len(model.lobe_model)))


def _chosen(model: SPMM, where: Selection | None, generator: torch.Generator) -> Tensor:
    """Random texels `[n]` among those that are selected at all; none if there are none."""
    candidates = torch.arange(model.texel_count)
    if where is not None:
        reach = torch.cat((where.entries.new_zeros(1), where.entries)).double().cumsum(0)
        touched = reach[model.offset[1:]] > reach[model.offset[:-1]]
        candidates = torch.nonzero(touched).squeeze(-1).cpu()
    number = SAMPLES if len(candidates) else 0
    order = torch.randint(max(1, len(candidates)), (number,), generator=generator)
    return candidates[order].to(model.offset.device)


def _means(values: Tensor, group: Tensor, groups: int) -> Tensor:
    """The mean of values `[E]` in each group, `[groups]`; that of all in groups without any."""
    zero = values.new_zeros(groups)
    total = zero.index_add(0, group, values)
    count = zero.index_add(0, group, torch.ones_like(values))
    overall = values.sum() / max(1, len(values))
    return torch.where(count > 0.0, total / count.clamp(min=1.0), overall)
