"""Rougher or smoother: the tilts of normals times a factor [WDR11 §5.3]."""

from __future__ import annotations

from dataclasses import dataclass, replace

import torch
from torch import Tensor

from ...config.schema import setting
from ...geometry.directions import MAX_TILT
from ...model.spmm import SPMM
from ..groups import group_setting, lobe_group, threshold_setting
from ..lobes import with_lobes
from ..options import MAX_FACTOR, check_factor
from ..selection import EVERYTHING, Selection

# A normal whose horizontal part is shorter than this has no azimuth to be tilted along.
UPRIGHT = 1e-7


@dataclass(frozen=True)
class SpreadNormals:
    """Rougher and more embossed, or smoother."""

    factor: float = setting(1.0, "factor on the tilts of normals", low=0.0, high=MAX_FACTOR)
    group: str = group_setting()
    threshold: float = threshold_setting()

    def apply(self, model: SPMM, where: Selection) -> SPMM:
        """The edited model."""
        where = where & lobe_group(model, self.group, self.threshold)
        return spread_normals(model, self.factor, where)


@torch.no_grad()
def spread_normals(model: SPMM, factor: float, where: Selection = EVERYTHING) -> SPMM:
    """Tilts normals further from the surface normal, or closer to it [WDR11 §5.3].

    The angle between each lobe's normal and z is multiplied by `factor`, up to MAX_TILT: above 1
    the surface looks rougher and more embossed, below 1 smoother. Azimuths stay, tangents are
    carried along. The residual is kept: it does not tilt.

    Args:
        model: the original.
        factor: not below 0; 0 makes all normals upright.
        where: what is edited.

    Raises:
        ConfigError: the factor is negative or not finite.
    """
    check_factor("factor on the spread of normals", factor)
    if factor == 1.0:
        return model
    lobes = model.dictionary.detach()
    return with_lobes(model, replace(lobes, normal=tilted(lobes.normal, factor)), where)


def tilted(normal: Tensor, factor: float) -> Tensor:
    """Normals `[J, 3]` with `factor` times their angle to z, MAX_TILT at most."""
    planar = normal[:, :2].norm(dim=1)
    tilt = torch.atan2(planar, normal[:, 2])
    # A normal beyond the limit may stay there.
    limit = tilt.clamp(min=MAX_TILT)
    target = torch.minimum(tilt * factor, limit)
    xy = normal[:, :2] * (torch.sin(target) / planar.clamp(min=UPRIGHT))[:, None]
    moved = torch.cat((xy, torch.cos(target)[:, None]), dim=1)
    return torch.where((planar > UPRIGHT)[:, None], moved, normal)
