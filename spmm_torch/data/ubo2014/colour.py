"""Conversion of the factored channels of a UBO2014 file to linear RGB, and back."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor

# Numbers of the colour models in the files.
RGB, LOG_YUV = 0, 11
# Offset that every file adds before a logarithm and subtracts after the exponential.
LOG_OFFSET = 1e-5
YUV_TO_RGB = ((1.0, 0.0, 1.13983), (1.0, -0.39465, -0.5806), (1.0, 2.03211, 0.0))


def decode(planes: Sequence[Tensor], colour_model: int, log_values: bool) -> list[Tensor]:
    """Linear RGB, not negative, of the three reconstructed channels, computed in their memory.

    Args:
        planes: three channels `[...]`, equal in shape.
        colour_model: colour model, RGB or LOG_YUV.
        log_values: whether the channels are logarithms of RGB.

    Returns:
        the planes `[...]` of R, G and B.
    """
    rgb = _rgb_from_log_yuv(*planes) if colour_model == LOG_YUV else list(planes)
    if log_values:
        rgb = [plane.exp_().sub_(LOG_OFFSET) for plane in rgb]
    return [plane.clamp_min_(0.0) for plane in rgb]  # keeps NaN, for which the caller checks


def _rgb_from_log_yuv(first: Tensor, second: Tensor, third: Tensor) -> list[Tensor]:
    """R, G and B `[...]` of the channels log Y, U / Y and V / Y `[...]`, in their memory."""
    (_, _, red_v), (_, green_u, green_v), (_, blue_u, _) = YUV_TO_RGB
    y = first.exp_().sub_(LOG_OFFSET)
    u = second.mul_(y).add_(LOG_OFFSET)
    v = third.mul_(y).add_(LOG_OFFSET)
    green = torch.add(y, u, alpha=green_u).add_(v, alpha=green_v)
    return [v.mul_(red_v).add_(y), green, u.mul_(blue_u).add_(y)]


def encode(values: Tensor, colour_model: int, log_values: bool) -> Tensor:
    """The channels `[..., 3]` to factor of linear RGB `[..., 3]`: the inverse of `decode`.

    Where Y is below 1e-5 the quotients of LOG_YUV are damped, lest they overflow; `decode` then
    gives RGB with an error below 1e-4.
    """
    if log_values:
        return (values + LOG_OFFSET).log()
    if colour_model == RGB:
        return values
    rgb_to_yuv = torch.tensor(YUV_TO_RGB, dtype=torch.float64).inverse().to(values)
    yuv = values @ rgb_to_yuv.T
    y = yuv[..., :1].clamp_min(0.0)
    quotients = (yuv[..., 1:] - LOG_OFFSET) / y.clamp_min(LOG_OFFSET)
    return torch.cat(((y + LOG_OFFSET).log(), quotients), dim=-1)
