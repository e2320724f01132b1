"""Edits of the lobes' frames: the normal distribution and the tangents [WDR11 §5.3]."""

from __future__ import annotations

import math

import torch
from torch import Tensor

from ..errors import ConfigError
from ..geometry.directions import MAX_TILT
from ..lobes.batch import LobeBatch, anisotropic_mask
from ..lobes.sampling import SPECULAR_WIDTH
from ..model.spmm import SPMM
from .groups import lobe_group
from .lobes import with_lobes
from .parts import check_factor
from .selection import Selection

# A normal whose horizontal part is shorter than this has no azimuth to be tilted along.
UPRIGHT = 1e-7


@torch.no_grad()
def spread_normals(
    model: SPMM,
    factor: float,
    where: Selection | None = None,
    group: str = "all",
    threshold: float = SPECULAR_WIDTH,
) -> SPMM:
    """Tilts normals further from, or closer to, the surface normal [WDR11 §5.3].

    The angle between each lobe's normal and z is multiplied by `factor`, up to MAX_TILT: above 1
    the surface looks rougher and more embossed, below 1 smoother. Azimuths stay, tangents are
    carried along. The residual is kept: it does not tilt.

    Args:
        factor: not below 0; 0 makes all normals upright.
        where: None for the whole texture.
        group: `all`, `specular` or `non_specular` lobes.
        threshold: width in radians under which a lobe is specular.

    Raises:
        ConfigError: a factor or group that is not valid, or a group without lobes.
    """
    check_factor("factor on the spread of normals", factor)
    chosen = lobe_group(model, group, threshold)
    if factor == 1.0:
        return model
    lobes = model.dictionary.detach()
    normal = tilted(lobes.normal, factor)
    if chosen is not None:
        normal = torch.where(chosen[:, None], normal, lobes.normal)
    return with_lobes(model, LobeBatch(lobes.model, lobes.kappa, normal, lobes.angle), where)


def tilted(normal: Tensor, factor: float) -> Tensor:
    """Normals `[J, 3]` with `factor` times their angle to z, MAX_TILT at most."""
    planar = normal[:, :2].norm(dim=1)
    tilt = torch.atan2(planar, normal[:, 2])
    # A normal that is tilted further than the limit already is not raised to it.
    limit = tilt.clamp(min=MAX_TILT)
    target = torch.minimum(tilt * factor, limit)
    xy = normal[:, :2] * (torch.sin(target) / planar.clamp(min=UPRIGHT))[:, None]
    moved = torch.cat((xy, torch.cos(target)[:, None]), dim=1)
    return torch.where((planar > UPRIGHT)[:, None], moved, normal)


@torch.no_grad()
def rotate_tangent(model: SPMM, angle: float, where: Selection | None = None) -> SPMM:
    """Turns the tangents of anisotropic lobes about their normals: brushed metal, turned.

    The residual is kept: it does not turn.

    Args:
        angle: radians, counter-clockwise seen from outside.
        where: None for the whole texture.

    Raises:
        ConfigError: the angle is not finite, or the model has no anisotropic lobes.
    """
    if not math.isfinite(angle):
        raise ConfigError(f"the turn of the tangents is {angle}; expected a finite angle.")
    lobes = model.dictionary.detach()
    turns = anisotropic_mask(lobes.model).to(lobes.angle.device)
    if not bool(turns.any()):
        raise ConfigError(
            "the model has no anisotropic lobes, so no tangent to turn; leave this edit out."
        )
    if angle == 0.0:
        return model
    turned = torch.where(turns, lobes.angle + angle, lobes.angle)
    return with_lobes(model, LobeBatch(lobes.model, lobes.kappa, lobes.normal, turned), where)
