"""Whether a relief pays: how much less the views disagree under lights that it has not seen.

Reading between texels smooths noise, so that any shift lowers the disagreement of noisy views. The
same shifts the other way smooth as much: what pays beats them, too. And a height for every texel is
freedom enough to find what agrees by chance, under other lights too, where neighbours differ in
their BRDFs. So heights must beat those found in views that are turned by a quarter about the
normal, in which no relief can show.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from torch import Tensor

from .pictures import PictureStack

# Least fraction of the disagreement that must vanish: about 0.2 dB of a model of the BTF.
MIN_GAIN = 0.05
# Least fraction of the disagreement of the pictures as they are, for a number or a few; and for a
# height of every texel: on two path-traced weaves, whose heights take off 3 %, they are worth
# nothing to a model.
MIN_SHARE, MAP_SHARE = 0.01, 0.05


def disagreement(stack: PictureStack, height: Tensor) -> float:
    """Mean disagreement of the views about points of `height [H, W]`; see `PictureStack`."""
    return float(stack.disagreement(height[None]).mean())


def plane_pays(stack: PictureStack, plane: Tensor, untouched: float) -> bool:
    """Whether a `plane [H, W]` of one height pays against none, under the lights of the stack.

    Args:
        stack: pictures to judge by.
        plane: height, in texture widths.
        untouched: disagreement of the pictures as they are.
    """
    after, before, control = (disagreement(stack, each) for each in (plane, 0.0 * plane, -plane))
    return _pays(after, min(before, control), MIN_SHARE * untouched)


def heights_pay(
    stack: PictureStack,
    height: Tensor,
    base: Tensor,
    untouched: float,
    by_chance: Callable[[], float],
) -> bool:
    """Whether a map `height [H, W]` pays against `base [H, W]`, under the lights of the stack.

    Args:
        stack: pictures to judge by.
        height, base: heights, in texture widths.
        untouched: disagreement of the pictures as they are.
        by_chance: tells the share of it that heights leave which cannot mean anything.
    """
    after, before = disagreement(stack, height), disagreement(stack, base)
    least, share = min(before, disagreement(stack, 2.0 * base - height)), MAP_SHARE * untouched
    return _pays(after, least, share) and _pays(after, by_chance() * untouched, share)


def drift_pays(stack: PictureStack, drift: Tensor, height: Tensor, untouched: float) -> bool:
    """Whether a `drift [V, 2]` in columns and rows pays over points of `height [H, W]`.

    Args:
        stack: pictures to judge by.
        drift: shift of each view.
        height: heights, in texture widths.
        untouched: disagreement of the pictures as they are.
    """
    after, before, control = (
        disagreement(replace(stack, drift=each), height) for each in (drift, 0.0 * drift, -drift)
    )
    return _pays(after, min(before, control), MIN_SHARE * untouched)


def _pays(after: float, before: float, share: float) -> bool:
    return before - after > max(MIN_GAIN * before, share)
