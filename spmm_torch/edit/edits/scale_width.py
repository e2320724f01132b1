"""Narrower or wider lobes: their widths times a factor [WDR11 §5.2]."""

from __future__ import annotations

from dataclasses import dataclass, replace

import torch

from ...brdf import REGISTRY
from ...config.schema import setting
from ...errors import ConfigError
from ...lobes.batch import LobeBatch
from ...model.spmm import SPMM
from ..groups import group_setting, lobe_group, threshold_setting
from ..lobes import with_lobes
from ..options import MAX_FACTOR, check_factor
from ..selection import EVERYTHING, Selection
from ..widths import power_law


@dataclass(frozen=True)
class ScaleWidth:
    """Narrower lobes, which look more metallic, or wider ones."""

    factor: float = setting(1.0, "factor on the widths", low=0.01, high=MAX_FACTOR)
    group: str = group_setting("specular")
    threshold: float = threshold_setting()
    keep_energy: bool = setting(False, "whether each lobe reflects as much as before")

    def apply(self, model: SPMM, where: Selection) -> SPMM:
        """The edited model."""
        where = where & lobe_group(model, self.group, self.threshold)
        return scale_width(model, self.factor, where, self.keep_energy)


@torch.no_grad()
def scale_width(
    model: SPMM, factor: float, where: Selection = EVERYTHING, keep_energy: bool = False
) -> SPMM:
    """Narrows or widens lobes: narrow specular ones look metallic [WDR11 §5.2].

    Every parameter that sets a width is set to that of `factor` times the width, within its
    physical bounds; lobes of models without one stay. The residual is kept: it still holds what
    was measured beside the old highlight (see `residual_strength`).

    Args:
        model: the original.
        factor: below 1 narrows, above 1 widens.
        where: what is edited.
        keep_energy: whether weights are scaled so that each lobe reflects as much as before;
            otherwise weights stay.

    Raises:
        ConfigError: the factor is not positive or not finite.
    """
    check_factor("factor on the width", factor)
    if factor == 0.0:
        raise ConfigError("factor on the width is 0; expected a positive number.")
    if factor == 1.0:
        return model
    return with_lobes(model, scaled_widths(model.dictionary.detach(), factor), where, keep_energy)


def scaled_widths(lobes: LobeBatch, factor: float) -> LobeBatch:
    """J lobes with `factor` times their widths, within the bounds of their parameters."""
    kappa = lobes.kappa.clone()
    for model, rows in lobes.by_model():
        for column, row in enumerate(REGISTRY[model].parameters):
            if row.from_width is not None:
                value = kappa[rows, column] * factor ** power_law(row.from_width)[1]
                kappa[rows, column] = value.clamp(row.low, row.high)
    return replace(lobes, kappa=kappa)
