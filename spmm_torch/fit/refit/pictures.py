"""The pictures of some views as the passes of a refit read them."""

from __future__ import annotations

import torch
from torch import Tensor

from ...data import BTF
from .lookups import Lookups


def pictures_of(pictures: BTF, run: slice, lookups: Lookups, device: torch.device) -> Tensor:
    """Values `[n, T, L C]` of n consecutive views, times the square roots of the pixels' weights.

    Args:
        pictures: as they were measured.
        run: the views.
        lookups: what each pixel shows, with the weights of pixels.
        device: where the values go.
    """
    values = pictures.views(run.start, run.stop).to(device)  # [T, n, L, C]
    values = values.transpose(0, 1).flatten(2)
    return values if lookups.pixel is None else values * lookups.pixel[:, None]
