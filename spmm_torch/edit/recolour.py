"""The edit of hue and saturation: weights and residual multiplied by M [WDR11 §5.1, Eq. 7]."""

from __future__ import annotations

import math

import torch
from torch import Tensor

from ..errors import ConfigError
from ..lobes.sampling import SPECULAR_WIDTH
from ..model.spmm import SPMM, SparseWeights
from . import residual as residuals
from .colour import check_change, linear_change, linear_changes, unit_colours
from .groups import edited_texels, entry_share, lobe_group
from .look import Look, sample_look
from .parts import check_colours, entry_texels, with_parts
from .selection import Selection

FITS = ("material", "unit")
# Unit colours have this part of the weight of the material's own: they settle what those leave
# open, as the colours of a grey material do, and nothing else.
UNIT_SHARE = 1e-6
PRIOR_COLOURS = 1000
# Keeps the weight of unit colours above 0 where the material is black.
TINY = 1e-12


@torch.no_grad()
def hue_saturation(
    model: SPMM,
    hue: float = 0.0,
    saturation: float = 1.0,
    where: Selection | None = None,
    group: str = "all",
    threshold: float = SPECULAR_WIDTH,
    fit: str = "material",
) -> SPMM:
    """Turns the hue and scales the saturation, all weights alpha becoming M alpha [WDR11 Eq. 7].

    A negative weight that M yields becomes 0; what that adds is taken from the other lobes of the
    same texel and channel, so that the texel reflects what Eq. 7 says (see `non_negative`). The
    residual of what is edited is multiplied by M too, unclamped, as it is signed; but where only a
    group of lobes is edited, or lobes are selected by a property, it stays as it is.

    Args:
        hue: turn in radians, from red towards green.
        saturation: factor, 0 (grey) to MAX_SATURATION.
        where: None for the whole texture.
        group: `all`, `specular` or `non_specular` lobes.
        threshold: width in radians under which a lobe is specular.
        fit: from which colours M is found [WDR11 Eq. 6]: those of the `material` where it is
            edited, or `unit` colours of all hues alike, by the table (paper).

    Raises:
        ConfigError: a value out of its range, a group without lobes, or a model that has not
            three channels.
    """
    check_colours(model)
    check_change(hue, saturation)
    if fit not in FITS:
        raise ConfigError(f"fit is {fit!r}; expected one of {', '.join(FITS)}.")
    lobes = lobe_group(model, group, threshold)
    if hue % (2.0 * math.pi) == 0.0 and saturation == 1.0:
        return model
    look = sample_look(model, where, lobes)
    matrix = linear_change(hue, saturation) if fit == "unit" else fitted(look, hue, saturation)
    matrix = matrix.to(model.weight)
    weight = non_negative(model, model.weight @ matrix.T, look.reflection)  # Eq. (7)
    share = entry_share(model, lobes, where)
    if share is not None:
        weight = torch.lerp(model.weight, weight, share[:, None])
    labels, residual = model.labels, model.residual
    reaches, texels = edited_texels(lobes, where)
    if reaches:
        labels, residual = residuals.mapped(model, matrix, texels)
    weights = SparseWeights(model.offset, model.index, weight)
    return with_parts(model, weights=weights, labels=labels, residual=residual)


def fitted(look: Look, hue: float, saturation: float) -> Tensor:
    """M `[3, 3]` that changes the colours of a look best, in float64 [WDR11 Eq. 6]."""
    own = look.colour.double().cpu()
    prior = unit_colours(PRIOR_COLOURS)
    strength = UNIT_SHARE * own.square().sum() / len(prior)
    colours = torch.cat((own, prior * strength.clamp(min=TINY).sqrt()))
    turn = torch.tensor([hue], dtype=torch.float64)
    return linear_changes(colours, turn, torch.tensor([saturation]))[0, 0]


def non_negative(model: SPMM, weight: Tensor, reflection: Tensor) -> Tensor:
    """Weights `[N, C]` with the negative ones set to 0, and the others of their texels lowered.

    In each texel and channel, the sum of weight times mean reflection stays what it was, if it was
    positive; otherwise all weights become 0.

    Args:
        weight: of the entries of the model, of any sign.
        reflection: mean of rho of each lobe, `[J]`.
    """
    if not bool((weight < 0.0).any()):
        return weight
    texel = entry_texels(model)
    size = reflection.index_select(0, model.index)[:, None]  # [N, 1]
    zero = weight.new_zeros(model.texel_count, weight.shape[1])
    kept = weight.clamp(min=0.0)
    reached = zero.index_add(0, texel, kept * size)  # [T, C]
    missed = zero.index_add(0, texel, weight.clamp(max=0.0) * size)  # 0 where none is negative
    factor = torch.where(reached > 0.0, (1.0 + missed / reached).clamp(min=0.0), 1.0)
    return kept * factor.index_select(0, texel)
