"""A measured BTF in the arrays of a variant: what the plug-in `btf` evaluates.

Values between measured directions and texels are those of `render.BTFMaterial`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch

from ..data import BTF
from ..errors import DataError
from ..geometry.directions import REPEAT
from ..geometry.grazing import lowest_cosine
from ..geometry.hemisphere import HemisphereInterpolation
from ..runtime.memory import slices
from .arrays import SMALLEST, float_array, half_array, index_array, loop, one, row
from .brdf.warp import cosine_pdf, square_to_cosine_hemisphere
from .hemisphere import Around, Mesh, Pairs
from .libraries import dr, mi
from .texels import block_at, block_corners

# Values up to which a BTF is kept as single floats, 1 GB; larger ones are kept as halves.
SINGLE_VALUES = 1 << 28
# Values that 32 bits can index.
MOST_VALUES = (1 << 32) - 1
# Values of whole texels that are decoded at once.
DECODED_VALUES = 1 << 24
# (texel, pair) that a lookup mixes: four times nine.
MIXED = 36


@dataclass(frozen=True)
class Seen:
    """What a view shows at a place.

    Attributes:
        block: of texels.
        weights: of its four texels, bilinear.
        wo: view.
        views: the measured views around it, and their weights.
    """

    block: Any
    weights: Sequence[Any]
    wo: Any
    views: Around


class Measured:
    """A BTF, sampled by the cosine; it has no parameters.

    Args:
        btf: of one or three channels.
    """

    def __init__(self, btf: BTF) -> None:
        _check(btf)
        self.parameters: dict[str, Any] = {}
        self.rows, self.columns, self.pairs = btf.height, btf.width, btf.pair_count
        self.light, self.view = (
            Mesh.build(HemisphereInterpolation.build(directions))
            for directions in (btf.light, btf.view)
        )
        self.lowest = lowest_cosine(btf.light)
        self.channels = btf.channels
        self.corners = index_array(block_corners(btf.height, btf.width, REPEAT))
        self.numbers = _values(btf)
        self.measured = None if btf.measured is None else float_array(btf.measured.float())

    def update(self, names: Sequence[str] = ()) -> None:
        """Nothing to do."""

    def seen(self, uv: Any, wo: Any) -> Seen:
        """What the view wo shows at uv, v up."""
        block, weights = block_at(uv, self.rows, self.columns, REPEAT)
        return Seen(block, weights, wo, self.view.around(wo))

    def evaluated(self, seen: Seen, wi: Any) -> tuple[Any, Any]:
        """(cosine-weighted RGB, density of `sample`) at wi; 0 under the horizon."""
        return self._value(seen, wi), cosine_pdf(wi)

    def _value(self, seen: Seen, wi: Any) -> Any:
        """RGB at wi."""
        lit = (wi.z > 0.0) & (seen.wo.z > 0.0)
        fade = dr.select(lit, dr.minimum(wi.z / self.lowest, 1.0), 0.0)
        pairs = Pairs.build(self.light.count, self.light.around(wi), seen.views, fade)
        share = self._missing_share(pairs)

        def add(n: Any, red: Any, green: Any, blue: Any) -> tuple[Any, ...]:
            corner = n // Pairs.COUNT
            pair, weight = pairs.of(n - Pairs.COUNT * corner)
            texel = one(self.corners, 4 * seen.block + corner)
            weight *= share * _chosen(corner, seen.weights)
            if self.measured is not None:
                weight *= one(self.measured, pair)
            values = self._pixel(texel * self.pairs + pair)
            sums = (s + weight * v for s, v in zip((red, green, blue), values, strict=True))
            return n + 1, *sums

        start = (dr.select(lit, mi.UInt32(0), mi.UInt32(MIXED)), *(mi.Float(0.0),) * 3)
        return mi.Color3f(*loop(start, lambda n, *_: n < MIXED, add)[1:])

    def sample(self, seen: Seen, u: Sequence[Any]) -> Any:
        """wi by the cosine, of the last two of three numbers."""
        return square_to_cosine_hemisphere(u[1:])

    def _missing_share(self, pairs: Pairs) -> Any:
        """What measured pairs count more, where they stand in for missing neighbours."""
        if self.measured is None:
            return 1.0
        each = [pairs.of(mi.UInt32(n)) for n in range(Pairs.COUNT)]
        whole = sum(weight for _, weight in each)
        kept = sum(weight * one(self.measured, pair) for pair, weight in each)
        return whole / dr.maximum(kept, SMALLEST)

    def _pixel(self, index: Any) -> list[Any]:
        """Red, green and blue of a (texel, pair)."""
        values = row(self.numbers, index, self.channels)
        return [mi.Float(values[min(c, self.channels - 1)]) for c in range(3)]


def _chosen(n: Any, four: Sequence[Any]) -> Any:
    """One of four numbers."""
    low, high = dr.select(n == 0, four[0], four[1]), dr.select(n == 2, four[2], four[3])
    return dr.select(n < 2, low, high)


def _check(btf: BTF) -> None:
    """Raises DataError if a BTF has too many values, or other channels than a picture."""
    if btf.channels not in (1, 3):
        raise DataError(
            f"{btf.name} has {btf.channels} channels; expected 1 or 3, which a picture in RGB can "
            f"show; choose them with spmm convert."
        )
    values = btf.texel_count * btf.pair_count * btf.channels
    if values > MOST_VALUES:
        raise DataError(
            f"{btf.name} has {values:,} values; expected at most {MOST_VALUES:,}, which 32 bits "
            f"can index; fit it, or crop it with spmm crop."
        )


def _values(btf: BTF) -> Any:
    """All values `[T, D, C]` in an array of the variant."""
    each = btf.pair_count * btf.channels
    single = btf.texel_count * each <= SINGLE_VALUES
    values = np.empty((btf.texel_count, each), np.float32 if single else np.float16)
    for block in slices(btf.texel_count, max(1, DECODED_VALUES // each)):
        values[block] = btf.texels(torch.arange(block.start, block.stop)).flatten(1).numpy()
    return float_array(values) if single else half_array(values)
