"""Pictures of any method, view after view, and how far they are from those that were measured."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache

import torch
from torch import Tensor

from ..data import BTF
from ..evaluate.slices import figures_of
from ..metrics import snr_db
from ..model.relief import Relief

# Number of a view -> linear values [T, L, C] under all lights.
OfView = Callable[[int], Tensor]


def through(of_view: OfView, btf: BTF, relief: Relief) -> OfView:
    """Pictures as they look through a relief, given the values of its surface points.

    Args:
        of_view: values of the surface points under the texels.
        btf: whose directions and texels they are.
        relief: of the surface, and the drift of its pictures.
    """
    field = relief.field(btf.height, btf.width, btf.view)

    def seen(view: int) -> Tensor:
        one = slice(view, view + 1)
        drift = None if relief.drift is None else relief.drift[one]
        return field.footprint(btf.view[one], drift).drawn(of_view(view))

    return seen


@torch.no_grad()
def snr_of_pictures(btf: BTF, of_view: OfView) -> float:
    """SNR in dB over all texels, pairs and channels of the measured pictures."""
    energy = error = 0.0
    for view in range(len(btf.view)):
        drawn = of_view(view)
        measured = btf.views(view, view + 1)[:, 0].to(drawn)  # [T, L, C]
        energy += float(measured.square().sum(dtype=torch.float64))
        error += float((measured - drawn).square().sum(dtype=torch.float64))
    return snr_db(energy, error)


@torch.no_grad()
def flip_of_pictures(btf: BTF, of_view: OfView) -> float | None:
    """Mean FLIP error of slices, as `display.flip` of a report; None without the extra `eval`."""
    kept = lru_cache(maxsize=1)(of_view)

    def picture(view: int, light: int) -> Tensor:
        return kept(view)[:, light].view(btf.height, btf.width, -1).float().cpu()

    return figures_of(btf, picture).display.flip.with_residual
