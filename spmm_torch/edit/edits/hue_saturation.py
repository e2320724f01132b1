"""Another hue and saturation: weights and residual times a matrix M [WDR11 §5.1, Eq. 7]."""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor

from ...config.schema import setting
from ...errors import ConfigError
from ...model.lookup import SparseWeights
from ...model.spmm import SPMM
from ..colour import MAX_SATURATION, check_change, linear_change, linear_changes, unit_colours
from ..entries import entry_texels
from ..groups import group_setting, lobe_group, threshold_setting
from ..look import Look, sample_look
from ..parts import with_parts
from ..residual import mapped_residual
from ..selection import EVERYTHING, Selection

FITS = ("material", "unit")
# Weight of unit colours beside the material's own: they settle what those leave open, as the
# colours of a grey material do, and nothing else.
UNIT_WEIGHT = 1e-6
PRIOR_COLOURS = 1000
# Keeps the weight of unit colours above 0 where the material is black.
LEAST_WEIGHT = 1e-12


@dataclass(frozen=True)
class HueSaturation:
    """Another hue, more or less saturation."""

    hue: float = setting(
        0.0, "turn of the hue in degrees, from red towards green", low=-360.0, high=360.0
    )
    saturation: float = setting(1.0, "factor on the saturation", low=0.0, high=MAX_SATURATION)
    group: str = group_setting()
    threshold: float = threshold_setting()
    fit: str = setting(
        "material",
        "colours that the change is fitted to: material, or unit (all hues alike; the paper's)",
        choices=FITS,
    )

    def apply(self, model: SPMM, where: Selection) -> SPMM:
        """The edited model."""
        where = where & lobe_group(model, self.group, self.threshold)
        return hue_saturation(model, math.radians(self.hue), self.saturation, where, self.fit)


@torch.no_grad()
def hue_saturation(
    model: SPMM,
    hue: float = 0.0,
    saturation: float = 1.0,
    where: Selection = EVERYTHING,
    fit: str = "material",
) -> SPMM:
    """Turns the hue and scales the saturation: weights alpha become M alpha [WDR11 Eq. 7].

    Where M makes a weight negative, it becomes 0, and the other lobes of the same texel and
    channel are lowered, so that the texel reflects what Eq. 7 says (see `non_negative`). The
    residual of whole texels is multiplied by M too, unclamped, as it is signed. It stays where
    only some lobes are selected.

    Args:
        model: the original.
        hue: turn in radians, from red towards green.
        saturation: factor, 0 (grey) to MAX_SATURATION.
        where: what is edited.
        fit: colours that M is fitted to [WDR11 Eq. 6]: `material`, those of the model where it is
            edited, or `unit`, colours of all hues alike, by the table (the paper's).

    Raises:
        ConfigError: a value out of its range, or a model without the three channels of RGB.
    """
    _check_channels(model)
    check_change(hue, saturation)
    if fit not in FITS:
        raise ConfigError(f"fit is {fit!r}; expected one of {', '.join(FITS)}.")
    if hue % (2.0 * math.pi) == 0.0 and saturation == 1.0:
        return model
    look = sample_look(model, where)
    matrix = linear_change(hue, saturation) if fit == "unit" else fitted(look, hue, saturation)
    matrix = matrix.to(model.weight)
    weight = non_negative(model, model.weight @ matrix.T, look.reflection)  # Eq. (7)
    share = where.entry_share(model)
    if share is not None:
        weight = torch.lerp(model.weight, weight, share[:, None])
    whole = mapped_residual(model, matrix, where)
    weights = SparseWeights(model.offset, model.index, weight)
    return with_parts(model, weights=weights, **vars(whole))


def fitted(look: Look, hue: float, saturation: float) -> Tensor:
    """M `[3, 3]` that changes the colours of a look best, in float64 [WDR11 Eq. 6].

    Args:
        look: of a model with three channels.
        hue: turn in radians.
        saturation: factor.
    """
    own = look.colour.double().cpu()
    prior = unit_colours(PRIOR_COLOURS)
    strength = UNIT_WEIGHT * own.square().sum() / len(prior)
    colours = torch.cat((own, prior * strength.clamp(min=LEAST_WEIGHT).sqrt()))
    turn = torch.tensor([hue], dtype=torch.float64)
    return linear_changes(colours, turn, torch.tensor([saturation]))[0, 0]


def non_negative(model: SPMM, weight: Tensor, reflection: Tensor) -> Tensor:
    """Weights `[N, C]` with the negative ones set to 0, and the others of their texels lowered.

    In each texel and channel, the sum of weight times mean reflection stays what it was if it was
    positive; otherwise all weights become 0.

    Args:
        model: whose entries they are.
        weight: of any sign, `[N, C]`.
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


def _check_channels(model: SPMM) -> None:
    channels = model.weight.shape[1]
    if channels != 3:
        raise ConfigError(
            f"the model has {channels} channels; a change of hue or saturation expects the three "
            f"of RGB; leave this edit out."
        )
