"""The edit of hue and saturation: weights and residual multiplied by M [WDR11 §5.1, Eq. 7]."""

from __future__ import annotations

import math

import torch
from torch import Tensor

from ..errors import ConfigError
from ..lobe_sampling import SPECULAR_WIDTH
from ..model import SPMM, SparseWeights
from . import residual as residuals
from .colour import check_change, linear_change, linear_changes, unit_colours
from .groups import edited_texels, entry_share, lobe_group
from .look import look_colours
from .parts import check_colours, with_parts
from .selection import Selection

FITS = ("material", "unit")
# Unit colours have this part of the weight of the material's own: they settle what those leave
# open, as the colours of a grey material do.
UNIT_SHARE = 0.001
PRIOR_COLOURS = 1000


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

    A negative weight that M yields becomes 0. The residual of what is edited is multiplied by M
    too, unclamped, as it is signed; but where only a group of lobes is edited, or lobes are
    selected by a property, it stays as it is.

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
    lobes = lobe_group(model, group, threshold)
    if hue % (2.0 * math.pi) == 0.0 and saturation == 1.0:
        return model
    matrix = change_matrix(model, hue, saturation, where, lobes, fit).to(model.weight)
    share = entry_share(model, lobes, where)
    weight = (model.weight @ matrix.T).clamp(min=0.0)  # Eq. (7)
    if share is not None:
        weight = torch.lerp(model.weight, weight, share[:, None])
    labels, residual = model.labels, model.residual
    reaches, texels = edited_texels(lobes, where)
    if reaches:
        labels, residual = residuals.mapped(model, matrix, texels)
    weights = SparseWeights(model.offset, model.index, weight)
    return with_parts(model, weights=weights, labels=labels, residual=residual)


def change_matrix(
    model: SPMM,
    hue: float,
    saturation: float,
    where: Selection | None = None,
    lobes: Tensor | None = None,
    fit: str = "material",
) -> Tensor:
    """M `[3, 3]` for a model, float32; arguments as of `hue_saturation`, lobes `[J]` bool."""
    if fit not in FITS:
        raise ConfigError(f"fit is {fit!r}; expected one of {', '.join(FITS)}.")
    if fit == "unit":
        return linear_change(hue, saturation)
    own = look_colours(model, where, lobes).double().cpu()  # [N, 3]
    prior = unit_colours(PRIOR_COLOURS)
    strength = UNIT_SHARE * own.square().sum() / len(prior)
    colours = torch.cat((own, prior * strength.clamp(min=1e-12).sqrt()))
    turn, factor = torch.tensor([hue], dtype=torch.float64), torch.tensor([saturation])
    return linear_changes(colours, turn, factor)[0, 0].float()
