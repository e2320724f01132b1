"""Changes of hue and saturation, and their best linear approximations M [WDR11 §5.1, Eq. 6].

A change e turns the hue by an angle and multiplies the saturation, both of HSV, on linear RGB.
Hue and saturation of HSV, unlike those of HLS, do not depend on brightness. So e(s c) = s e(c),
unit colours stand for all, and values above 1 keep their meaning.
"""

from __future__ import annotations

import math
from functools import lru_cache

import torch
from torch import Tensor
from torch.nn.functional import normalize

from ..errors import ConfigError

# 100 x 100 = 10,000 changes from 10,000 colours [WDR11 §5.1].
HUE_STEPS, SATURATION_STEPS, UNIT_COLOURS = 100, 100, 10_000
MAX_SATURATION = 2.0
COLOUR_SEED = 0
# Colours are divided by their largest channel; one that is darker than this counts as black.
DARKEST = 1e-30


def change_colours(rgb: Tensor, hue: float, saturation: float) -> Tensor:
    """The exact change e of colours, `[..., 3]`.

    Args:
        rgb: linear RGB, `[..., 3]`; a negative value counts as 0.
        hue: turn in radians, from red towards green.
        saturation: factor on the saturation of HSV, which stays at most 1.
    """
    h, s, v = _hsv(rgb)
    changed = torch.stack(
        (torch.remainder(h + hue, 2.0 * math.pi), (s * saturation).clamp(max=1.0))
    )
    pure = _pure(torch.stack((*changed, torch.ones_like(v))))  # [3, N]
    return (pure * v).T.reshape(rgb.shape)


def _pure(hsv: Tensor) -> Tensor:
    """RGB `[3, N]` of hue (radians), saturation and value `[3, N]`."""
    from kornia.color import hsv_to_rgb  # half a second to load

    return hsv_to_rgb(hsv[:, :, None])[:, :, 0]


def _hsv(rgb: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Hue (radians), saturation and value of colours `[..., 3]`, flattened to `[N]` each."""
    from kornia.color import rgb_to_hsv  # half a second to load

    flat = rgb.reshape(-1, 3).clamp(min=0.0)
    value = flat.amax(1)
    # The guard against black in kornia is absolute: dark colours would lose saturation.
    even = flat / value.clamp(min=DARKEST)[:, None]
    h, s, _ = rgb_to_hsv(even.T[:, :, None])[:, :, 0]
    return h, s, value


@lru_cache
def unit_colours(count: int = UNIT_COLOURS) -> Tensor:
    """Unit vectors `[count, 3]` float64, even over the positive octant of RGB."""
    generator = torch.Generator().manual_seed(COLOUR_SEED)
    return normalize(torch.randn(count, 3, generator=generator, dtype=torch.float64).abs(), dim=1)


def linear_changes(colours: Tensor, hue: Tensor, saturation: Tensor) -> Tensor:
    """M of all A x B changes, by least squares in closed form [WDR11 Eq. 6].

    e is separable: with chroma q = v min(1, s * saturation) and the pure colour p of the turned
    hue, e(c) = (v - q) + q p, so all moments sum_c e(c) c^T are one product of matrices.

    Args:
        colours: `[N, 3]`; as e(s c) = s e(c), their lengths are weights.
        hue: turns `[A]`, radians.
        saturation: factors `[B]`.

    Returns:
        `[A, B, 3, 3]`, in the type of the colours.
    """
    h, s, v = _hsv(colours)
    chroma = (s * saturation.to(s)[:, None]).clamp(max=1.0) * v  # [B, N]
    grey = ((v - chroma) @ colours)[:, None, :]  # [B, 1, 3], equal for all channels of e(c)
    inverse = torch.linalg.inv(colours.T @ colours)
    one = torch.ones_like(h)
    rows = []
    for turn in hue.tolist():
        turned = torch.stack((torch.remainder(h + turn, 2.0 * math.pi), one, one))
        pure = _pure(turned).T  # [N, 3]
        products = (pure[:, :, None] * colours[:, None, :]).flatten(1)  # [N, 9], p c^T
        moment = (chroma @ products).unflatten(1, (3, 3)) + grey  # sum_c e(c) c^T
        rows.append(moment @ inverse)  # Eq. (6)
    return torch.stack(rows)


@lru_cache(maxsize=1)
def change_table() -> Tensor:
    """M of 10,000 changes from 10,000 unit colours: `[100, 100, 3, 3]` float32, 352 KB.

    Hues are even over a turn from 0, saturations from 0 to MAX_SATURATION. Made at first use, in
    about a second.
    """
    hue = torch.arange(HUE_STEPS) * (2.0 * math.pi / HUE_STEPS)
    saturation = torch.linspace(0.0, MAX_SATURATION, SATURATION_STEPS)
    return linear_changes(unit_colours(), hue, saturation).float()


def linear_change(hue: float, saturation: float) -> Tensor:
    """M `[3, 3]` of any change, bilinear between those of the table [WDR11 §5.1].

    Args:
        hue: turn in radians.
        saturation: factor.

    Raises:
        ConfigError: not finite, or a saturation beyond the table.
    """
    check_change(hue, saturation)
    across = (hue / (2.0 * math.pi) % 1.0) * HUE_STEPS
    along = saturation / MAX_SATURATION * (SATURATION_STEPS - 1)
    row, column = int(across) % HUE_STEPS, min(int(along), SATURATION_STEPS - 2)
    table = change_table()[[row, (row + 1) % HUE_STEPS], column : column + 2]  # [2, 2, 3, 3]
    low, high = torch.lerp(table[0], table[1], across - int(across))
    return torch.lerp(low, high, along - column)


def check_change(hue: float, saturation: float) -> None:
    """Checks a change of hue and saturation.

    Raises:
        ConfigError: not finite, or a saturation out of 0 to MAX_SATURATION.
    """
    if not math.isfinite(hue):
        raise ConfigError(f"the turn of the hue is {hue}; expected a finite angle.")
    if not 0.0 <= saturation <= MAX_SATURATION:
        raise ConfigError(
            f"the saturation factor is {saturation}; expected 0 to {MAX_SATURATION:g}."
        )
