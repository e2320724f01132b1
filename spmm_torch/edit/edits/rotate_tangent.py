"""Anisotropic highlights turned: the tangents of lobes rotated about their normals."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import torch

from ...config.schema import setting
from ...errors import ConfigError
from ...lobes.batch import anisotropic_mask
from ...model.spmm import SPMM
from ..lobes import with_lobes
from ..selection import EVERYTHING, Selection


@dataclass(frozen=True)
class RotateTangent:
    """Anisotropic highlights, turned."""

    angle: float = setting(0.0, "turn in degrees, counter-clockwise", low=-360.0, high=360.0)

    def apply(self, model: SPMM, where: Selection) -> SPMM:
        """The edited model."""
        return rotate_tangent(model, math.radians(self.angle), where)


@torch.no_grad()
def rotate_tangent(model: SPMM, angle: float, where: Selection = EVERYTHING) -> SPMM:
    """Turns the tangents of anisotropic lobes about their normals: brushed metal, turned.

    The residual is kept: it does not turn.

    Args:
        model: the original.
        angle: radians, counter-clockwise seen from outside.
        where: what is edited.

    Raises:
        ConfigError: the angle is not finite, or the model has no anisotropic lobes.
    """
    if not math.isfinite(angle):
        raise ConfigError(f"the turn of the tangents is {angle}; expected a finite angle.")
    lobes = model.dictionary.detach()
    turns = anisotropic_mask(lobes.model)
    if not bool(turns.any()):
        raise ConfigError(
            "the model has no anisotropic lobes, so no tangent to turn; leave this edit out."
        )
    if angle == 0.0:
        return model
    turned = torch.where(turns, lobes.angle + angle, lobes.angle)
    return with_lobes(model, replace(lobes, angle=turned), where)
