"""Height maps that are given: a picture file, or the map that a `.btf` carries."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from ...data import BTF, ubo2014
from ...errors import DataError
from ...synthesize.maps import read_grey
from .pictures import PictureStack, spread
from .plane import HIGHEST_PLANE, LOWEST_PLANE, MAX_VIEWS

# Range of the height of white above black that is sought, in texture widths, and steps of it.
LEAST_SCALE, GREATEST_SCALE, SCALES = 0.004, 0.3, 32
# Candidate heights and offsets, and the texels of a side on which the scale is sought.
HEIGHTS, OFFSETS, SIDE = 96, 64, 64


def read_heights(path: Path | str, height: int, width: int) -> Tensor:
    """Heights `[H, W]` in [0, 1] from a grey picture of 8 or 16 bits or floats.

    Raises:
        DataError: the file is no grey picture, of another size, or holds values that are no
            heights, such as NaN.
    """
    codes = read_grey(path, "height")
    if codes.shape != (height, width):
        raise DataError(
            f"height map {path} is {codes.shape[1]} x {codes.shape[0]} but the pictures of the BTF "
            f"are {width} x {height}; expected one height for each texel; rescale it."
        )
    return torch.from_numpy(np.ascontiguousarray(codes, dtype=np.float32))


def stored_heights(btf: BTF) -> Tensor | None:
    """The height map of the `.btf` file of a BTF, `[H, W]` in [0, 1]; None if it has none.

    The unit of such maps is not stated, so that only their shape counts. A map that does not fit
    the pictures, or is not finite, counts as none.
    """
    path = Path(btf.path)
    if not btf.path or not ubo2014.accepts(path):
        return None
    header = ubo2014.read_header(path, btf.read_as.rows)
    codes = header.height_map
    if codes is None or codes.shape != (header.height, header.width):
        return None
    values = torch.from_numpy(codes.view(np.float16).astype(np.float32)).flatten()
    low, high = values.aminmax()
    if not bool(torch.isfinite(values).all()) or bool(low == high):
        return None
    shape = (values - low) / (high - low)
    shape = shape if btf.part.texels is None else shape[btf.part.texels]
    return shape.view(btf.height, btf.width)


def best_scale(stack: PictureStack, shape: Tensor) -> tuple[float, float]:
    """The scale and offset, in texture widths, by which a `shape [H, W]` explains most parallax.

    Negative scales, of depths in place of heights, are tried too. The disagreement of all views is
    computed once for a range of heights, and then looked up for each scale and offset.
    """
    level = stack.reduced(-(-max(stack.size) // SIDE))
    count = min(MAX_VIEWS, len(level.slope))
    level = level.part(views=spread(level.slope, count, int(level.slope.norm(dim=1).argmax())))
    small = torch.nn.functional.interpolate(shape[None, None], level.size, mode="area")[0, 0]
    small = small.to(level.values.device) - small.mean().item()
    low, high = LOWEST_PLANE - 0.5 * GREATEST_SCALE, HIGHEST_PLANE + 0.5 * GREATEST_SCALE
    heights = torch.linspace(low, high, HEIGHTS, device=small.device)
    cost = level.disagreement(heights[:, None, None].expand(-1, *level.size))
    magnitudes = torch.logspace(
        np.log10(LEAST_SCALE), np.log10(GREATEST_SCALE), SCALES, device=small.device
    )
    offsets = torch.linspace(LOWEST_PLANE, HIGHEST_PLANE, OFFSETS, device=small.device)
    scales = torch.cat((magnitudes, -magnitudes))
    costs = torch.stack([_looked_up(cost, low, high, scale * small, offsets) for scale in scales])
    best = int(costs.argmin())
    scale, offset = float(scales[best // OFFSETS]), float(offsets[best % OFFSETS])
    return scale, offset - scale * float(shape.mean())


def _looked_up(cost: Tensor, low: float, high: float, height: Tensor, offsets: Tensor) -> Tensor:
    """Mean cost `[N]` of `height [H, W]` plus each of `offsets [N]`, from `cost [M, H, W]`.

    The costs are those of M heights evenly from `low` to `high`.
    """
    last = len(cost) - 1
    place = (height + offsets[:, None, None] - low) / (high - low) * last
    place = place.clamp(0.0, last - 1e-3)
    index = place.long()
    share = place - index
    return torch.lerp(cost.gather(0, index), cost.gather(0, index + 1), share).mean((1, 2))
