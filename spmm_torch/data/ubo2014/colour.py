"""Conversion of the factored channels of a UBO2014 file to linear RGB, and back.

Numbers and formulas of the colour models are those of the library of the format's authors
(github.com/cgbonn/btflib, `undecorrelate` and `restore_dynamic_range`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

Matrix3 = tuple[tuple[float, ...], ...]

# Numbers of the colour models in the files.
RGB, YUV, PCA, YCOCG, LOG_Y, LOG_YUV, LOG_Y_RATIOS, LOG_RGB = 0, 1, 3, 4, 9, 10, 11, 12
# Models that this package reads, with words for them; 2 (CIELAB), 5 and 6 (spectra) are not known
# from any file.
MODELS = {
    RGB: "RGB",
    YUV: "YUV",
    PCA: "PCA",
    YCOCG: "YCoCg",
    LOG_Y: "log Y, U, V",
    LOG_YUV: "log Y, log U, log V",
    LOG_Y_RATIOS: "log Y, U / Y, V / Y",
    LOG_RGB: "log RGB",
}
# Offset that every file adds before a logarithm and subtracts after the exponential.
LOG_OFFSET = 1e-5
YUV_TO_RGB = ((1.0, 0.0, 1.13983), (1.0, -0.39465, -0.5806), (1.0, 2.03211, 0.0))
YCOCG_TO_RGB = ((1.0, 1.0, -1.0), (1.0, 0.0, 1.0), (1.0, -1.0, -1.0))
IDENTITY = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
ZERO = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Encoding:
    """How the channels of a file stand for RGB.

    Args:
        model: colour model, one of MODELS.
        log_values: whether what the model gives are logarithms of RGB.
        transform: matrix of PCA, rows by channel of the file, columns by R, G and B.
        mean: R, G and B of PCA where all channels are zero.
    """

    model: int = RGB
    log_values: bool = False
    transform: Matrix3 = IDENTITY
    mean: tuple[float, ...] = ZERO

    @property
    def is_linear(self) -> bool:
        """Whether values are the channels themselves."""
        return self.model == RGB and not self.log_values

    def mixing(self) -> tuple[Matrix3, tuple[float, ...]]:
        """The matrix, a row each for R, G and B, and the offset that the model ends with."""
        if self.model == PCA:
            return tuple(zip(*self.transform, strict=True)), self.mean
        if self.model in (RGB, LOG_RGB):
            return IDENTITY, ZERO
        return (YCOCG_TO_RGB if self.model == YCOCG else YUV_TO_RGB), ZERO


def decode(planes: Sequence[Tensor], encoding: Encoding) -> list[Tensor]:
    """Linear RGB, not negative, of the three reconstructed channels, whose memory is reused.

    Args:
        planes: three channels `[...]`, equal in shape.
        encoding: what they stand for.

    Returns:
        the planes `[...]` of R, G and B.
    """
    channels = _without_logarithms(planes, encoding.model)
    matrix, offset = encoding.mixing()
    if matrix != IDENTITY or any(offset):
        pairs = zip(matrix, offset, strict=True)
        channels = [_mixed(channels, weights, constant) for weights, constant in pairs]
    if encoding.log_values:
        channels = [plane.exp_().sub_(LOG_OFFSET) for plane in channels]
    return [plane.clamp_min_(0.0) for plane in channels]  # keeps NaN, for which the caller checks


def _without_logarithms(planes: Sequence[Tensor], model: int) -> list[Tensor]:
    """The channels `[...]` that a model mixes to RGB, in the memory of those in the file."""
    first, second, third = planes
    if model == LOG_RGB:
        return [plane.exp_().sub_(LOG_OFFSET) for plane in planes]
    if model not in (LOG_Y, LOG_YUV, LOG_Y_RATIOS):
        return [first, second, third]
    y_and_offset = first.exp_()
    if model == LOG_Y_RATIOS:  # of U and V to the sum of Y and the offset
        second, third = second.mul_(y_and_offset), third.mul_(y_and_offset)
    elif model == LOG_YUV:
        second, third = _signed_exponential(second), _signed_exponential(third)
    return [y_and_offset.sub_(LOG_OFFSET), second, third]


def _signed_exponential(plane: Tensor) -> Tensor:
    """The values `[...]` whose magnitudes, in units of the offset, are stored as logarithms."""
    return plane.sign() * (plane.abs() + math.log(LOG_OFFSET)).exp()


def _mixed(planes: Sequence[Tensor], weights: Sequence[float], constant: float) -> Tensor:
    """The weighted sum `[...]` of three planes, and a constant."""
    total = torch.full_like(planes[0], constant)
    for plane, weight in zip(planes, weights, strict=True):
        if weight:
            total.add_(plane, alpha=weight)
    return total


def encode(values: Tensor, encoding: Encoding) -> Tensor:
    """The channels `[..., 3]` to factor of linear RGB `[..., 3]`: the inverse of `decode`.

    Only for RGB, for LOG_Y_RATIOS, and for logarithms of RGB.
    """
    if encoding.log_values:
        return (values + LOG_OFFSET).log()
    if encoding.model == RGB:
        return values
    rgb_to_yuv = torch.tensor(YUV_TO_RGB, dtype=torch.float64).inverse().to(values)
    yuv = values @ rgb_to_yuv.T
    y_and_offset = yuv[..., :1].clamp_min(0.0) + LOG_OFFSET
    return torch.cat((y_and_offset.log(), yuv[..., 1:] / y_and_offset), dim=-1)
