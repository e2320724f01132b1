"""Whether a relief pays: how much less the views disagree under lights that it has not seen.

Reading between texels smooths noise, so that any shift lowers the disagreement of noisy views. The
same shifts the other way smooth as much: what pays beats them, too.
"""

from __future__ import annotations

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


def heights_pay(stack: PictureStack, height: Tensor, base: Tensor, untouched: float) -> bool:
    """Whether `height [H, W]` pays against `base [H, W]`, under the lights of the stack.

    A map of heights must take off more than a plane.

    Args:
        stack: pictures to judge by.
        height, base: heights, in texture widths.
        untouched: disagreement of the pictures as they are.
    """
    share = MIN_SHARE if bool((height == height[0, 0]).all()) else MAP_SHARE
    after, before = disagreement(stack, height), disagreement(stack, base)
    return _pays(after, before, disagreement(stack, 2.0 * base - height), share * untouched)


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
    return _pays(after, before, control, MIN_SHARE * untouched)


def _pays(after: float, before: float, control: float, share: float) -> bool:
    least = min(before, control)
    return least - after > max(MIN_GAIN * least, share)
