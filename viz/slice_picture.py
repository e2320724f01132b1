"""The texture seen from above, as a picture."""

from __future__ import annotations

import torch
from numpy.typing import NDArray
from torch import Tensor

from ..geometry.directions import direction_from_angles
from ..model.spmm import SPMM
from ..render.display import auto_exposure, display_codes

# Light from the upper left shows structure; the view is from above, so the texture is upright.
LIGHT = (0.6, 2.4)
VIEW = (0.0, 0.0)


def direction(angles: tuple[float, float], like: Tensor) -> Tensor:
    """The unit vector `[3]` of polar angle and azimuth in radians."""
    theta, phi = torch.tensor(angles, dtype=torch.float64)
    return direction_from_angles(theta, phi).to(like)


@torch.no_grad()
def slice_codes(model: SPMM, exposure: float | None = None) -> NDArray:
    """8-bit codes `[H, W, 3]` of the texture from above, lit from the upper left.

    Args:
        model: of the texture.
        exposure: factor on linear values; None for that of `auto_exposure`.
    """
    linear = slice_picture(model)
    if exposure is None:
        exposure = auto_exposure([linear], [torch.ones_like(linear[..., 0])])
    return display_codes(linear, exposure)


@torch.no_grad()
def slice_picture(model: SPMM) -> Tensor:
    """Linear values `[H, W, 3]` of the texture from above, lit from the upper left."""
    wi, wo = (direction(angles, model.weight) for angles in (LIGHT, VIEW))
    return model.picture(wi, wo)
