"""Texels whose colour under one light and view lies in a range."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from ...config.schema import REQUIRED, setting
from ...errors import ConfigError
from ...geometry.directions import direction_from_angles
from ...model.spmm import SPMM
from ..selection import Selection, select_texels


@dataclass(frozen=True)
class ColourMask:
    """Texels whose colour under one light and view lies in a range."""

    low: tuple[float, ...] = setting(REQUIRED, "the lowest linear RGB")
    high: tuple[float, ...] = setting(REQUIRED, "the highest linear RGB")
    soft: float = setting(0.0, "distance from the range over which the mask fades to 0", low=0.0)
    light: tuple[float, ...] = setting((0.0, 0.0), "theta and phi of the light in degrees")
    view: tuple[float, ...] = setting((0.0, 0.0), "theta and phi of the view in degrees")

    def select(self, model: SPMM) -> Selection:
        """Its texels in a model."""
        wi, wo = _direction("light", self.light), _direction("view", self.view)
        return colour_selection(model, wi, wo, self.low, self.high, self.soft)


@torch.no_grad()
def colour_selection(
    model: SPMM,
    wi: Tensor,
    wo: Tensor,
    low: Sequence[float],
    high: Sequence[float],
    soft: float = 0.0,
) -> Selection:
    """Texels whose colour under one light and view lies in a range.

    Args:
        model: whose texels are selected.
        wi: unit direction of the light, `[3]`.
        wo: unit direction of the view, `[3]`.
        low: linear cosine-weighted value of each channel, as `SPMM.picture` gives it.
        high: likewise.
        soft: distance from the range, in the same values, over which shares fade to 0.

    Raises:
        ConfigError: bounds that are not one number a channel, or in the wrong order.
    """
    picture = model.picture(wi.to(model.weight), wo.to(model.weight))
    bounds = torch.tensor([list(low), list(high)]).to(picture) if len(low) == len(high) else None
    channels = picture.shape[2]
    if bounds is None or bounds.shape[1] != channels or bool((bounds[0] > bounds[1]).any()):
        raise ConfigError(
            f"the colour range is {list(low)} to {list(high)}; expected {channels} numbers each, "
            f"the lower ones first."
        )
    outside = torch.maximum(bounds[0] - picture, picture - bounds[1]).amax(2)  # [H, W]
    if soft > 0.0:
        return select_texels(model, (1.0 - outside / soft).clamp(0.0, 1.0))
    return select_texels(model, outside <= 0.0)


def _direction(name: str, angles: tuple[float, ...]) -> Tensor:
    """The unit direction `[3]` of theta and phi in degrees."""
    if len(angles) != 2 or not 0.0 <= angles[0] < 90.0:
        raise ConfigError(
            f"the {name} of a colour mask is {list(angles)}; expected theta and phi in degrees, "
            f"theta from 0 to below 90."
        )
    theta, phi = torch.deg2rad(torch.tensor(angles)).unbind()
    return direction_from_angles(theta, phi)
