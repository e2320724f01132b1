"""Sharpness, PSNR and FLIP of slices: pictures of all texels under one direction pair.

The slices are those of `slice_sample`, which stand for all.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import torch
from torch import Tensor

from ..data import BTF
from ..model.spmm import SPMM
from ..render.display import Codes, display_codes
from ..report.contract import FLIP, PSNR, Display, Sharpness
from .display import WHITE, display_psnr
from .flip import flip_map
from .sharpness import GradientSums
from .slice_sample import pairs_from_above, spread_pairs

# Every second slice is enough for FLIP, which takes longest; and the middle of large ones.
FLIP_STEP, FLIP_SIZE = 2, 128

# (view, light) -> the linear picture [H, W, C] of a direction pair.
PictureOf = Callable[[int, int], Tensor]


@dataclass(frozen=True)
class SliceFigures:
    """What slices tell of a model."""

    sharpness: Sharpness
    display: Display


@torch.no_grad()
def slice_figures(model: SPMM, btf: BTF) -> SliceFigures:
    """The figures of a model, held against the BTF that it was fitted to."""
    return figures_of(btf, model_pictures(model, btf), model_pictures(model, btf, residual=False))


def model_pictures(model: SPMM, btf: BTF, residual: bool = True) -> PictureOf:
    """Pictures of a model under the directions of a BTF, on the CPU."""

    def picture(view: int, light: int) -> Tensor:
        wi, wo = btf.light[light].to(model.light), btf.view[view].to(model.view)
        return model.picture(wi, wo, residual, registered=True).float().cpu()

    return picture


def figures_of(btf: BTF, whole: PictureOf, lobes: PictureOf | None = None) -> SliceFigures:
    """The figures of anything that gives pictures.

    Args:
        btf: the original.
        whole: pictures of the whole model.
        lobes: those without a residual; None if there is no such thing.
    """
    spread = spread_pairs(btf)
    exposure = 1.0 / btf.peak()
    above, everywhere = GradientSums(), GradientSums()
    for pair in pairs_from_above(btf):
        above += GradientSums.of(btf.picture(*pair), whole(*pair))
    with_residual, without_residual = Scores(), Scores()
    for index, pair in enumerate(spread):
        original, model = btf.picture(*pair), whole(*pair)
        everywhere += GradientSums.of(original, model)
        codes, with_flip = display_codes(original, exposure), index % FLIP_STEP == 0
        with_residual.add(codes, display_codes(model, exposure), with_flip)
        if lobes is not None:
            without_residual.add(codes, display_codes(lobes(*pair), exposure), with_flip)
    sharpness = Sharpness(
        above.share, everywhere.share, above.share_in_place, everywhere.share_in_place
    )
    parts = (without_residual, with_residual)
    psnr = PSNR(*(_mean(part.psnr) for part in parts))
    return SliceFigures(
        sharpness, Display(psnr, FLIP(*(_mean(part.flip) for part in parts)), len(spread))
    )


class Scores:
    """PSNR and FLIP of slices, one after another."""

    def __init__(self) -> None:
        self.psnr: list[float] = []
        self.flip: list[float] = []

    def add(self, original: Codes, model: Codes, with_flip: bool) -> None:
        """Takes in the codes `[H, W, C]` of a slice."""
        self.psnr.append(display_psnr(original, model))
        if not with_flip:
            return
        error = flip_map(*(_middle(codes) / WHITE for codes in (original, model)))
        if error is not None:
            self.flip.append(float(error.mean()))


def _middle(codes: Codes) -> Codes:
    """The middle of a slice, at most `FLIP_SIZE` texels along each side."""
    height, width = (min(size, FLIP_SIZE) for size in codes.shape[:2])
    top, left = (codes.shape[0] - height) // 2, (codes.shape[1] - width) // 2
    return codes[top : top + height, left : left + width]


def _mean(values: Iterable[float]) -> float | None:
    """The mean; None of nothing."""
    listed = list(values)
    return sum(listed) / len(listed) if listed else None
