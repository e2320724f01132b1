"""Widths of lobes, and the parameters that set them [WDR11 §5.2]."""

from __future__ import annotations

import math
from collections.abc import Callable

import torch
from torch import Tensor

from ..brdf import REGISTRY
from ..lobes.batch import LobeBatch


def power_law(from_width: Callable[[float], float]) -> tuple[float, float]:
    """(a, b) of the value a * width^b of a width parameter; each of them is such a law."""
    one, two = from_width(1.0), from_width(2.0)
    return one, math.log2(two / one)


def widths(lobes: LobeBatch) -> Tensor:
    """Width of each lobe in radians (slope of the half vector where a lobe falls to 1/e), `[J]`.

    The smaller one of an anisotropic lobe; infinite where the model has no width.
    """
    width = torch.full_like(lobes.angle, torch.inf)
    for model, rows in lobes.by_model():
        for column, row in enumerate(REGISTRY[model].parameters):
            if row.from_width is not None:
                a, b = power_law(row.from_width)
                width[rows] = torch.minimum(width[rows], (lobes.kappa[rows, column] / a) ** (1 / b))
    return width
