"""Parameters of texels as textures of 8 bits, and what renderers read from them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from ..render.display import (
    SRGB_GAMMA,
    SRGB_KNEE,
    SRGB_SCALE,
    SRGB_SLOPE,
    encode_display,
    encode_png,
)

LEVELS = 255.0


@dataclass(frozen=True)
class Plane:
    """Codes of 0 to 255, and what they mean.

    Attributes:
        codes: `[T, n]` uint8.
        read: values as a renderer decodes them, `[T, n]`.
    """

    codes: Tensor
    read: Tensor

    @classmethod
    def linear(cls, values: Tensor, low: float = 0.0, high: float = 1.0) -> Plane:
        """Values `[T, n]` between two bounds, in even steps."""
        codes = torch.round((values - low) / (high - low) * LEVELS).clamp(0.0, LEVELS)
        return cls(codes.to(torch.uint8), low + codes / LEVELS * (high - low))

    @classmethod
    def colour(cls, values: Tensor, factor: Tensor | float = 1.0) -> Plane:
        """Colours `[T, 3]` by the curve of sRGB, which a renderer multiplies by a factor."""
        codes = torch.round(encode_display(values / factor) * LEVELS)
        return cls(codes.to(torch.uint8), decode_display(codes / LEVELS) * factor)


def decode_display(shown: Tensor) -> Tensor:
    """Linear values of display values `[...]` in 0..1, by the curve of sRGB."""
    curve = ((shown + (SRGB_SCALE - 1.0)) / SRGB_SCALE) ** SRGB_GAMMA
    return torch.where(shown <= SRGB_SLOPE * SRGB_KNEE, shown / SRGB_SLOPE, curve)


def picture(height: int, width: int, *planes: Plane | int) -> bytes:
    """A PNG whose channels are those of the planes, row 0 at the top; a number fills a channel."""
    texels = height * width
    columns = [
        np.full((texels, 1), plane, np.uint8)
        if isinstance(plane, int)
        else plane.codes.cpu().numpy()
        for plane in planes
    ]
    codes = np.concatenate(columns, axis=1).reshape(height, width, -1)
    return encode_png(codes[..., 0] if codes.shape[2] == 1 else codes)


def normal_planes(slope: Tensor) -> Plane:
    """Normals of x and y `[T, 2]`, as all three of their numbers."""
    z = (1.0 - slope.square().sum(-1, keepdim=True)).clamp(min=0.0).sqrt()
    return Plane.linear(torch.cat((slope, z), dim=1), -1.0, 1.0)


def axis_planes(vector: Tensor) -> tuple[Plane, Plane]:
    """Unit vectors `[T, 2]` along the axes of `vector [T, 2]`, and their strengths `[T, 1]`.

    An axis has two vectors: the one that is nearer to the mean axis, so that neighbours agree.
    """
    strength = vector.square().sum(-1, keepdim=True).sqrt()
    half = 0.5 * torch.atan2(vector[:, 1], vector[:, 0])
    sums = vector.sum(0)
    mean = 0.5 * torch.atan2(sums[1], sums[0])
    turn = torch.pi * torch.round((half - mean) / torch.pi)
    angle = half - turn
    direction = torch.stack((torch.cos(angle), torch.sin(angle)), dim=-1)
    return Plane.linear(direction, -1.0, 1.0), Plane.linear(strength.clamp(max=1.0))
