"""Products of factors, decoded to RGB tile by tile."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor
from torch.nn.functional import pad

from .colour import Encoding, decode

# Size (texels, direction pairs) of a tile: its three channels fit in the cache of a core, or fill a
# GPU. Matrix products of other sizes may round differently, but a value must not depend on its
# neighbours in a request: therefore every tile is padded with zeros to its full number of rows.
CPU_TILE = (64, 2048)
GPU_TILE = (1024, 8192)
# Smallest number of pairs of a product: narrower ones run through other code, which rounds
# differently.
MIN_PAIRS = 16


@dataclass(frozen=True)
class LeftFactors:
    """The factors of direction pairs, on one device.

    Args:
        planes: U of each channel, transposed `[k, D + MIN_PAIRS]`; columns past D are zero.
        encoding: what the channels stand for.
    """

    planes: tuple[Tensor, ...]
    encoding: Encoding

    @classmethod
    def build(cls, planes: Sequence[Tensor], encoding: Encoding) -> LeftFactors:
        """The factors of U `[D, k]` of each channel."""
        return cls(tuple(pad(plane.T, (0, MIN_PAIRS)) for plane in planes), encoding)

    def to(self, device: torch.device) -> LeftFactors:
        """The same factors on another device."""
        return LeftFactors(tuple(plane.to(device) for plane in self.planes), self.encoding)


def multiply(right: Sequence[Tensor], left: LeftFactors, start: int, out: Tensor) -> Tensor:
    """Fills `out [n, D', C]` with the values of n texels under the pairs from `start` on.

    Args:
        right: SV `[n, k]` of each channel, or a single one for all channels.
        left: factors of the direction pairs.
        start: index of the first pair.
        out: result.

    Returns:
        the largest value `[]`; NaN if any value is NaN.
    """
    tile_texels, tile_pairs = CPU_TILE if out.device.type == "cpu" else GPU_TILE
    count, width = out.shape[:2]
    maxima = []
    for row in range(0, count, tile_texels):
        rows = [part[row : row + tile_texels] for part in right]
        used = len(rows[0])
        rows = [pad(part, (0, 0, 0, tile_texels - used)) for part in rows]
        for column in range(0, width, tile_pairs):
            size = min(tile_pairs, width - column)
            first = start + column
            planes = _tile(rows, left, slice(first, first + max(size, MIN_PAIRS)))
            target = out[row : row + used, column : column + size]
            for channel, plane in enumerate(planes):
                wanted = plane[:used, :size]
                target[..., channel] = wanted
                maxima.append(wanted.max())
    return torch.stack(maxima).max()


def _tile(right: Sequence[Tensor], left: LeftFactors, pairs: slice) -> list[Tensor]:
    """Planes `[n, D']` of R, G and B of some texels and pairs."""
    parts = right if len(right) > 1 else [right[0]] * len(left.planes)
    products = [part @ plane[:, pairs] for part, plane in zip(parts, left.planes, strict=True)]
    return decode(products, left.encoding)
