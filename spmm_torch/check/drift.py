"""Registration of the views: how far their pictures lie from that of the most frontal one."""

from __future__ import annotations

import warnings
from dataclasses import dataclass

import numpy as np
import torch
from skimage.registration import phase_cross_correlation
from torch import Tensor

# Views up to this polar angle are compared: steeper ones look too different.
LOWEST_VIEW = 0.5  # cosine of 60 degrees
# Least side of pictures, and least correlation of two pictures once they lie on each other.
LEAST_SIDE, LEAST_LIKENESS = 16, 0.5
PARTS_OF_A_TEXEL = 20


@dataclass(frozen=True)
class Drift:
    """How views are registered, in texels.

    Attributes:
        views: number of views that could be compared.
        slope: shift of a view by its tangent, as a plane above or below that of the texture has.
        rest: largest shift that no such plane explains; None: views cannot be compared.
    """

    views: int
    slope: float
    rest: float | None


def drift(pictures: Tensor, view: Tensor) -> Drift:
    """Shifts of the pictures of views.

    Args:
        pictures: mean pictures `[V, h, w]`.
        view: unit vectors `[V, 3]`.
    """
    if min(pictures.shape[1:]) < LEAST_SIDE:
        return Drift(0, 0.0, None)
    reference = int(view[:, 2].argmax())
    shifts, tangents = [], []
    for index in range(len(view)):
        if float(view[index, 2]) > LOWEST_VIEW and index != reference:
            shift = _shift(pictures[reference].numpy(), pictures[index].numpy())
            if shift is not None:
                shifts.append(shift)
                tangents.append(view[index, :2] / view[index, 2])
    if not shifts:
        return Drift(0, 0.0, None)
    moved, tangent = torch.tensor(shifts), torch.stack(tangents)  # [n, 2]
    tangent = tangent - view[reference, :2] / view[reference, 2]
    slope = float((moved * tangent).sum() / tangent.square().sum().clamp(min=1e-9))
    rest = (moved - slope * tangent).norm(dim=1)
    return Drift(len(rest), slope, float(rest.max()))


def _shift(reference: np.ndarray, picture: np.ndarray) -> tuple[float, float] | None:
    """Shift (right, up) in texels of a picture against another; None where they are not alike."""
    window = np.outer(np.hanning(reference.shape[0]), np.hanning(reference.shape[1]))
    one, other = (window * (each - each.mean()) for each in (reference, picture))
    if not (one.any() and other.any()):
        return None
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of pictures without texture, which are left out below
        back, _, _ = phase_cross_correlation(one, other, upsample_factor=PARTS_OF_A_TEXEL)
    rolled = np.roll(picture, np.round(back).astype(int), (0, 1))
    inner = tuple(slice(side // 4, side - side // 4) for side in picture.shape)
    likeness = np.corrcoef(reference[inner].ravel(), rolled[inner].ravel())[0, 1]
    if not likeness > LEAST_LIKENESS:  # NaN is not, either
        return None
    return float(-back[1]), float(back[0])
