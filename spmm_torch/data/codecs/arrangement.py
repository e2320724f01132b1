"""The arrangement of decoded pictures: which side is up, and which channels there are."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from .base import UnsuitableError

# The tag of TIFF and EXIF that says how a picture was held; 1 is upright.
ORIENTATION_TAG = 0x0112
# What makes a picture `[H, W, B]` upright, by that tag.
TURNS: dict[int, Callable[[np.ndarray], np.ndarray]] = {
    2: lambda codes: codes[:, ::-1],
    3: lambda codes: codes[::-1, ::-1],
    4: lambda codes: codes[::-1],
    5: lambda codes: codes.swapaxes(0, 1),
    6: lambda codes: np.rot90(codes, -1),
    7: lambda codes: np.rot90(codes, 2).swapaxes(0, 1),
    8: lambda codes: np.rot90(codes),
}


def upright(codes: np.ndarray, orientation: object) -> np.ndarray:
    """A picture `[H, W, B]` as its orientation tag says; as it is if that says nothing known."""
    turn = TURNS.get(orientation) if isinstance(orientation, int) else None
    return codes if turn is None else np.ascontiguousarray(turn(codes))


def rgb_of(codes: np.ndarray, ignore_alpha: bool = False) -> np.ndarray:
    """The channels `[H, W, 3]` of grey or RGB `[H, W, B]`, with or without a last one for alpha.

    Args:
        codes: B = 1 grey, 2 grey and alpha, 3 RGB, 4 RGB and alpha.
        ignore_alpha: read what is transparent as if it were not.

    Raises:
        ValueError: the picture is transparent somewhere, or has another number of channels.
    """
    width = codes.shape[2]
    if not 1 <= width <= 4:
        raise UnsuitableError(
            f"it has {width} channels; expected grey or RGB, with or without alpha: convert it"
        )
    if width in (2, 4) and not ignore_alpha:
        opaque = np.iinfo(codes.dtype).max if codes.dtype.kind == "u" else 1.0
        if not (codes[..., -1] == opaque).all():
            raise UnsuitableError("it is transparent in places; flatten it onto what is behind it")
    colour = codes[..., :3] if width >= 3 else np.repeat(codes[..., :1], 3, axis=2)
    return np.ascontiguousarray(colour)
