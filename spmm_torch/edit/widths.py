"""Widths of lobes: read, and edited by a factor [WDR11 §5.2]."""

from __future__ import annotations

import math

import torch
from torch import Tensor

from ..brdf import REGISTRY, Parameter
from ..errors import ConfigError
from ..lobes.batch import LobeBatch
from ..lobes.sampling import SPECULAR_WIDTH
from ..model.spmm import SPMM
from .groups import lobe_group
from .lobes import with_lobes
from .parts import check_factor
from .selection import Selection


def power_law(parameter: Parameter) -> tuple[float, float]:
    """(a, b) of the value a * width^b that a width parameter has; all of them are such laws."""
    one, two = parameter.from_width(1.0), parameter.from_width(2.0)
    return one, math.log2(two / one)


def widths(lobes: LobeBatch) -> Tensor:
    """Width of each lobe in radians (root mean square slope of the half vector), `[J]`.

    Of an anisotropic one the narrower; infinite where the model has no width.
    """
    width = torch.full_like(lobes.angle, torch.inf)
    for model, rows in rows_by_model(lobes):
        for column, row in enumerate(REGISTRY[model].parameters):
            if row.from_width is not None:
                a, b = power_law(row)
                width[rows] = torch.minimum(width[rows], (lobes.kappa[rows, column] / a) ** (1 / b))
    return width


def rows_by_model(lobes: LobeBatch) -> list[tuple[int, Tensor]]:
    """(model, its lobes) for every model that occurs."""
    device = lobes.kappa.device
    return [
        (model, torch.nonzero(lobes.model == model).squeeze(-1).to(device))
        for model in torch.unique(lobes.model).tolist()
    ]


@torch.no_grad()
def scale_width(
    model: SPMM,
    factor: float,
    where: Selection | None = None,
    group: str = "specular",
    threshold: float = SPECULAR_WIDTH,
    keep_energy: bool = False,
) -> SPMM:
    """Narrows or widens lobes: narrow specular ones look metallic [WDR11 §5.2].

    Every parameter that sets a width is set to that of `factor` times the width, within its
    physical bounds; models without one stay as they are. The residual is kept: it still holds
    what was measured beside the old highlight (see `residual_strength`).

    Args:
        factor: below 1 narrows, above 1 widens.
        where: None for the whole texture.
        group: `specular`, `non_specular` or `all` lobes.
        threshold: width in radians under which a lobe is specular.
        keep_energy: scale weights so that each lobe reflects as much as before; otherwise its
            weight is kept, whatever its model makes of that.

    Raises:
        ConfigError: a factor that is not positive, a group that is unknown or without lobes.
    """
    check_factor("factor on the width", factor)
    if factor == 0.0:
        raise ConfigError("factor on the width is 0; expected a positive number.")
    chosen = lobe_group(model, group, threshold)
    if factor == 1.0:
        return model
    lobes = scaled_widths(model.dictionary.detach(), factor, chosen)
    return with_lobes(model, lobes, where, keep_energy)


def scaled_widths(lobes: LobeBatch, factor: float, chosen: Tensor | None = None) -> LobeBatch:
    """Lobes with `factor` times their width, where `chosen [J]` is true; None for all."""
    kappa = lobes.kappa.clone()
    for model, rows in rows_by_model(lobes):
        for column, row in enumerate(REGISTRY[model].parameters):
            if row.from_width is not None:
                value = kappa[rows, column] * factor ** power_law(row)[1]
                kappa[rows, column] = value.clamp(row.low, row.high)
    if chosen is not None:
        kappa = torch.where(chosen[:, None], kappa, lobes.kappa)
    return LobeBatch(lobes.model, kappa, lobes.normal, lobes.angle)
