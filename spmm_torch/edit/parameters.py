"""Edits of kappa itself, and of the model that it belongs to: both beyond the paper."""

from __future__ import annotations

import difflib

import torch
from torch import Tensor

from ..brdf import MODEL_NAMES, REGISTRY, Parameter
from ..errors import ConfigError
from ..lobes.batch import LobeBatch, anisotropic_mask
from ..lobes.sampling import SPECULAR_WIDTH
from ..model.spmm import SPMM
from .groups import lobe_group
from .lobes import with_lobes
from .selection import Selection
from .widths import power_law, rows_by_model, widths

# What a lobe gets that had no such parameter: no Fresnel effect, the mirror direction.
NEUTRAL = {"f0": 1.0, "c_xy": -1.0}
# The width of a lobe that had none, as it comes from a diffuse model: as wide as they get.
DIFFUSE_WIDTH = 1.0


@torch.no_grad()
def set_parameter(model: SPMM, name: str, value: float, where: Selection | None = None) -> SPMM:
    """Sets a parameter of all selected lobes whose model has one of this name.

    Weights and the residual are kept.

    Args:
        name: as in the tables of the BRDFs, such as `exponent`, `alpha` or `f0`.
        value: in its own unit.
        where: None for all lobes; `select_lobes` chooses some.

    Raises:
        ConfigError: no lobe of the model has it, or the value is out of its physical bounds.
    """
    lobes = model.dictionary.detach()
    kappa, found = lobes.kappa.clone(), False
    for index, rows in rows_by_model(lobes):
        for column, row in enumerate(REGISTRY[index].parameters):
            if row.name == name:
                _check_value(row, value, MODEL_NAMES[index])
                kappa[rows, column], found = value, True
    if not found:
        raise ConfigError(_unknown_parameter(name, lobes))
    return with_lobes(model, LobeBatch(lobes.model, kappa, lobes.normal, lobes.angle), where)


def _check_value(row: Parameter, value: float, owner: str) -> None:
    if not row.low <= value <= row.high:
        raise ConfigError(
            f"{row.name} of {owner} is {value:g}; expected {row.low:g} to {row.high:g}."
        )


def _unknown_parameter(name: str, lobes: LobeBatch) -> str:
    present = torch.unique(lobes.model).tolist()
    known = sorted({row.name for index in present for row in REGISTRY[index].parameters})
    near = difflib.get_close_matches(name, known, n=1)
    hint = f"did you mean {near[0]}?" if near else f"valid: {', '.join(known) or 'none'}."
    return f"no lobe of the model has a parameter {name}; {hint}"


@torch.no_grad()
def replace_model(
    model: SPMM,
    name: str,
    where: Selection | None = None,
    group: str = "all",
    threshold: float = SPECULAR_WIDTH,
) -> SPMM:
    """Replaces the model of lobes by another of the same width, normal and energy.

    Parameters of equal names are taken over within their bounds, the others get neutral values.
    A lobe that had no width, as it was diffuse, becomes DIFFUSE_WIDTH wide. The residual is kept.

    Args:
        name: of the BRDF.
        where: None for the whole texture.
        group: `all`, `specular` or `non_specular` lobes.
        threshold: width in radians under which a lobe is specular.

    Raises:
        ConfigError: unknown model or group, or a group without lobes.
    """
    if name not in MODEL_NAMES:
        near = difflib.get_close_matches(name, MODEL_NAMES, n=1)
        hint = f"did you mean {near[0]}?" if near else f"valid: {', '.join(MODEL_NAMES)}."
        raise ConfigError(f"unknown BRDF {name}; {hint}")
    chosen = lobe_group(model, group, threshold)
    lobes = model.dictionary.detach()
    target = MODEL_NAMES.index(name)
    moved = lobes.model.to(lobes.kappa.device) != target
    if chosen is not None:
        moved = moved & chosen
    kind = torch.where(moved.cpu(), target, lobes.model)
    kappa = torch.where(moved[:, None], _matched(lobes, target), lobes.kappa)
    turns = anisotropic_mask(kind).to(lobes.angle.device)
    angle = torch.where(turns, lobes.angle, torch.zeros_like(lobes.angle))
    return with_lobes(model, LobeBatch(kind, kappa, lobes.normal, angle), where, keep_energy=True)


def _matched(lobes: LobeBatch, target: int) -> Tensor:
    """Parameters `[J, MAX_PARAMETERS]` of the BRDF `target` that come closest to each lobe's."""
    kappa = torch.zeros_like(lobes.kappa)
    width = widths(lobes)
    width = torch.where(width.isinf(), DIFFUSE_WIDTH, width)
    for column, row in enumerate(REGISTRY[target].parameters):
        if row.from_width is not None:
            a, b = power_law(row)
            value = a * width**b
        else:
            value = torch.full_like(width, NEUTRAL.get(row.name, 0.5 * (row.low + row.high)))
        kappa[:, column] = _taken_over(lobes, row, value).clamp(row.low, row.high)
    return kappa


def _taken_over(lobes: LobeBatch, target: Parameter, value: Tensor) -> Tensor:
    """`value [J]` with that of the lobe where it has a parameter of the same name and kind."""
    value = value.clone()
    for model, rows in rows_by_model(lobes):
        for column, row in enumerate(REGISTRY[model].parameters):
            same_law = (row.from_width is None) == (target.from_width is None)
            if row.name == target.name and same_law and _equal_law(row, target):
                value[rows] = lobes.kappa[rows, column]
    return value


def _equal_law(first: Parameter, second: Parameter) -> bool:
    """Whether equal values of two parameters mean equal widths; true where they set none."""
    return first.from_width is None or power_law(first) == power_law(second)
