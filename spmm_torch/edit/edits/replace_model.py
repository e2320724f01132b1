"""Lobes of another BRDF in place of others, of the same width and energy; beyond the paper."""

from __future__ import annotations

from dataclasses import dataclass, replace

import torch
from torch import Tensor

from ...brdf import MODEL_NAMES, REGISTRY, Parameter
from ...config.schema import REQUIRED, setting
from ...errors import ConfigError
from ...lobes.batch import LobeBatch, anisotropic_mask
from ...model.spmm import SPMM
from ..groups import group_setting, lobe_group, threshold_setting
from ..lobes import with_lobes
from ..options import nearest
from ..selection import EVERYTHING, Selection
from ..widths import power_law, widths

# Parameters that a lobe did not have before: no Fresnel effect, the mirror direction.
NEUTRAL = {"f0": 1.0, "c_xy": -1.0}
# Width in radians of a lobe that had none, as its model was diffuse: as wide as they get.
DIFFUSE_WIDTH = 1.0


@dataclass(frozen=True)
class ReplaceModel:
    """Another BRDF of the same width and energy."""

    name: str = setting(REQUIRED, "the name of a BRDF", choices=MODEL_NAMES)
    group: str = group_setting()
    threshold: float = threshold_setting()

    def apply(self, model: SPMM, where: Selection) -> SPMM:
        """The edited model."""
        where = where & lobe_group(model, self.group, self.threshold)
        return replace_model(model, self.name, where)


@torch.no_grad()
def replace_model(model: SPMM, name: str, where: Selection = EVERYTHING) -> SPMM:
    """Replaces the BRDF of lobes by another of the same width, normal and energy.

    Parameters of equal names are taken over within their bounds, others get neutral values. A
    lobe without a width, as its BRDF is diffuse, becomes DIFFUSE_WIDTH wide. The residual is kept.

    Args:
        model: the original.
        name: of the BRDF.
        where: what is edited.

    Raises:
        ConfigError: unknown BRDF.
    """
    if name not in MODEL_NAMES:
        raise ConfigError(f"unknown BRDF {name}; {nearest(name, MODEL_NAMES)}")
    lobes = model.dictionary.detach()
    target = MODEL_NAMES.index(name)
    moved = lobes.model != target
    kind = torch.full_like(lobes.model, target)
    kappa = torch.where(moved[:, None], _matched(lobes, target), lobes.kappa)
    turns = anisotropic_mask(kind)
    angle = torch.where(turns, lobes.angle, torch.zeros_like(lobes.angle))
    other = replace(lobes, model=kind, kappa=kappa, angle=angle)
    return with_lobes(model, other, where, keep_energy=True)


def _matched(lobes: LobeBatch, target: int) -> Tensor:
    """Parameters `[J, MAX_PARAMETERS]` of the BRDF `target` that come closest to each lobe's."""
    kappa = torch.zeros_like(lobes.kappa)
    width = widths(lobes)
    width = torch.where(width.isinf(), DIFFUSE_WIDTH, width)
    for column, row in enumerate(REGISTRY[target].parameters):
        if row.from_width is not None:
            a, b = power_law(row.from_width)
            value = a * width**b
        else:
            value = torch.full_like(width, NEUTRAL.get(row.name, 0.5 * (row.low + row.high)))
        kappa[:, column] = _taken_over(lobes, row, value).clamp(row.low, row.high)
    return kappa


def _taken_over(lobes: LobeBatch, target: Parameter, value: Tensor) -> Tensor:
    """`value [J]`, replaced by that of each lobe with a parameter of the same name and law."""
    value = value.clone()
    for model, rows in lobes.by_model():
        for column, row in enumerate(REGISTRY[model].parameters):
            if row.name == target.name and _equal_law(row, target):
                value[rows] = lobes.kappa[rows, column]
    return value


def _equal_law(first: Parameter, second: Parameter) -> bool:
    """Whether equal values of two parameters mean equal widths, or neither sets one."""
    if first.from_width is None or second.from_width is None:
        return first.from_width is second.from_width
    return power_law(first.from_width) == power_law(second.from_width)
