"""Choice among several starts of the same problems."""

from __future__ import annotations

import torch
from torch import Tensor


def best_of(value: Tensor, x: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Best start of each problem; NaN counts as the worst value.

    Args:
        value: `[S, R]`, R starts of each of S problems.
        x: `[S, R, P]`.

    Returns:
        x `[S, P]`, value `[S]`, and which start `[S]` won.
    """
    which = torch.where(value.isnan(), torch.inf, value).argmin(1)  # [S]
    row = torch.arange(value.shape[0], device=value.device)
    return x[row, which], value[row, which], which
