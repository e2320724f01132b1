"""Whether a texture continues over its border: steps across the border against steps inside."""

from __future__ import annotations

from torch import Tensor

from .pictures import PictureStack

REPEAT, MIRROR = "repeat", "mirror"
# Mean square of a step across the border over that of steps inside, under which there is no seam:
# in a texture whose neighbours correlate by 0.4, a seam has 1.7.
LEAST_SEAM = 1.7
# Quantile of the steps inside, between all neighbouring rows, that a seam exceeds by a margin:
# threads and joints are steps, too, and may lie at the border.
QUANTILE, MARGIN = 0.95, 1.1


def border_rule(stack: PictureStack) -> str:
    """How the texture continues: "repeat", or "mirror" where left and right, or top and bottom,
    do not fit each other.

    A texture without relation between neighbours has no seam, and repeats.
    """
    steepest = int(stack.slope.norm(dim=1).argmin())
    pictures = stack.values[steepest][stack.weight[steepest] > 0.0]  # [L, H, W]
    seams = _has_seam(pictures) or _has_seam(pictures.transpose(1, 2))
    return MIRROR if seams else REPEAT


def _has_seam(pictures: Tensor) -> bool:
    """Whether the last row of `pictures [L, H, W]` is farther from the first than rows inside."""
    if pictures.shape[0] == 0 or pictures.shape[1] < 2:
        return False
    inside = pictures.diff(dim=1).square().mean((0, 2))  # [H - 1]
    across = float((pictures[:, 0] - pictures[:, -1]).square().mean())
    usual = float(inside.quantile(QUANTILE))
    return across > max(LEAST_SEAM * float(inside.mean()), MARGIN * usual)
