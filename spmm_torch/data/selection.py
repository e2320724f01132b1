"""Selection of a part of a BTF, for quick looks and for scenes that need no more."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from ..config.fit import DataConfig
from ..errors import ConfigError, DataError
from .btf import BTF

# Largest difference of the polar angles of a ring: 0.1 degree, to which formats round.
RING_TOLERANCE = math.radians(0.1)
# Indices of directions: one, or the first and the last.
INDICES = re.compile(r"\s*(\d{1,9})\s*(?:-\s*(\d{1,9})\s*)?")
DIRECTIONS_HELP = (
    "expected a number K for every K-th ring of polar angles, a list of polar angles in degrees "
    "such as 0,30,60, or lists of indices such as views=0,4-8;lights=0-20"
)


@dataclass(frozen=True)
class Selection:
    """A part of a BTF, as in settings and on the command line.

    Args:
        crop: rectangle (x0, y0, width, height) in texels, from the top left; None: all.
        texels: approximate number of texels, one from each cell of a regular grid; None: all.
        directions: every K-th ring, polar angles or indices, see `DIRECTIONS_HELP`; None: all.
    """

    crop: tuple[int, ...] | None = None
    texels: int | None = None
    directions: str | None = None

    @classmethod
    def of(cls, settings: DataConfig) -> Selection:
        """The part in the settings of a fit."""
        return cls(settings.crop, settings.texels, settings.directions)

    def added_to(self, settings: DataConfig) -> DataConfig:
        """Settings of a fit that name this part."""
        crop = None if self.crop is None else tuple(self.crop)
        return replace(settings, crop=crop, texels=self.texels, directions=self.directions)


def select_part(btf: BTF, selection: Selection, seed: int = 0) -> BTF:
    """The selected part of a BTF; nothing is decoded.

    Args:
        btf: whole BTF.
        selection: part to keep.
        seed: seed of the random choice of texels.

    Raises:
        ConfigError: the selection is malformed.
        DataError: the BTF has no such part.
    """
    if selection.crop is not None:
        btf = _cropped(btf, selection.crop)
    if selection.texels is not None:
        btf = _thinned(btf, selection.texels, seed)
    if selection.directions is not None:
        views, lights = _directions(btf, selection.directions)
        btf = btf.restricted(views=views, lights=lights)
    return btf


def _cropped(btf: BTF, crop: tuple[int, ...]) -> BTF:
    if len(crop) != 4:
        raise ConfigError(f"crop is {list(crop)}; expected x0,y0,width,height in texels.")
    x0, y0, width, height = crop
    if (
        min(x0, y0) < 0
        or min(width, height) < 1
        or x0 + width > btf.width
        or (y0 + height > btf.height)
    ):
        raise DataError(
            f"crop {x0},{y0},{width},{height} does not lie inside the pictures of {btf.name}, "
            f"which are {btf.width} x {btf.height}; expected x0,y0,width,height counted from the "
            f"top left."
        )
    row = torch.arange(y0, y0 + height)
    column = torch.arange(x0, x0 + width)
    return btf.restricted((row[:, None] * btf.width + column).flatten(), (height, width))


def _thinned(btf: BTF, count: int, seed: int) -> BTF:
    """One random texel from each cell of a grid of about `count` cells, as a picture."""
    if count < 1:
        raise ConfigError(f"texels is {count}; expected a number of at least 1.")
    if count >= btf.texel_count:
        return btf
    height, width = _grid_of(count, btf.height, btf.width)
    generator = torch.Generator().manual_seed(seed)
    row = _jittered(btf.height, height, width, generator)  # [height, width]
    column = _jittered(btf.width, width, height, generator).T
    return btf.restricted((row * btf.width + column).flatten(), (height, width))


def _grid_of(count: int, height: int, width: int) -> tuple[int, int]:
    """Rows and columns of a grid of about `count` cells, in the shape of a picture.

    The short side is rounded first, so that the long one can make up for it.
    """
    if height > width:
        columns, rows = _grid_of(count, width, height)
        return rows, columns
    rows = max(round(math.sqrt(count * height / width)), math.ceil(count / width))
    return rows, round(count / rows)


def _jittered(size: int, cells: int, columns: int, generator: torch.Generator) -> Tensor:
    """Random positions `[cells, columns]` in each of `cells` equal parts of `size`."""
    edge = torch.arange(cells + 1) * size // cells
    low, span = edge[:-1, None], edge.diff()[:, None]
    return low + (torch.rand(cells, columns, generator=generator) * span).long()


def _directions(btf: BTF, text: str) -> tuple[Tensor, Tensor]:
    """Indices `[V']` of the views and `[L']` of the lights that a text names."""
    if "=" in text:
        return _by_index(btf, text)
    try:
        numbers = [float(part) for part in text.split(",")]
    except ValueError as error:
        raise _malformed(text) from error
    if not all(map(math.isfinite, numbers)):
        raise _malformed(text)
    if len(numbers) > 1:
        wanted = torch.tensor(numbers, dtype=torch.float64).deg2rad()
        return _at_polar(btf.view, wanted, text, "view"), _at_polar(
            btf.light, wanted, text, "light"
        )
    step = int(numbers[0])
    if step < 1 or step != numbers[0]:
        raise _malformed(text)
    return _every_ring(btf.view, step), _every_ring(btf.light, step)


def _polar(directions: Tensor) -> Tensor:
    """Polar angles `[N]` of directions `[N, 3]`, in radians."""
    exact = directions.double()
    return torch.atan2(exact[:, :2].norm(dim=1), exact[:, 2])


def _every_ring(directions: Tensor, step: int) -> Tensor:
    """Indices of `directions [N, 3]` on every `step`-th ring, from the pole."""
    polar = _polar(directions)
    order = polar.argsort(stable=True)
    ring = torch.zeros(len(polar), dtype=torch.long)
    ring[order[1:]] = (polar[order].diff() > RING_TOLERANCE).cumsum(0)
    return torch.nonzero(ring % step == 0).squeeze(1)


def _at_polar(directions: Tensor, wanted: Tensor, text: str, kind: str) -> Tensor:
    """Indices of `directions [N, 3]` at one of the `wanted` polar angles `[n]`, in radians."""
    distance = (_polar(directions)[:, None] - wanted).abs()  # [N, polar angles]
    missing = distance.amin(0) > RING_TOLERANCE
    if missing.any():
        rings = sorted({round(angle, 1) for angle in _polar(directions).rad2deg().tolist()})
        raise DataError(
            f"directions {text!r} asks for a polar angle of "
            f"{float(wanted[missing][0].rad2deg()):g} degrees, which no {kind} has; the measured "
            f"ones are {', '.join(f'{angle:g}' for angle in rings)}."
        )
    return torch.nonzero((distance <= RING_TOLERANCE).any(1)).squeeze(1)


def _by_index(btf: BTF, text: str) -> tuple[Tensor, Tensor]:
    """Indices `[V']` and `[L']` in a text such as `views=0,4-8;lights=0-20`."""
    counts = {"views": len(btf.view), "lights": len(btf.light)}
    chosen = {key: torch.arange(count) for key, count in counts.items()}
    for assignment in text.split(";"):
        key, _, numbers = assignment.partition("=")
        key = key.strip()
        if key not in counts:
            raise _malformed(text)
        ranges = _ranges(numbers, text)
        highest = max(last for _, last in ranges)
        if highest >= counts[key]:
            raise DataError(
                f"directions {text!r} names number {highest} of the {key}, but {btf.name} has "
                f"{counts[key]}, counted from 0."
            )
        indices = {index for first, last in ranges for index in range(first, last + 1)}
        chosen[key] = torch.tensor(sorted(indices))
    return chosen["views"], chosen["lights"]


def _ranges(numbers: str, text: str) -> list[tuple[int, int]]:
    """Ranges (first, last) in a text such as `0,4-8`."""
    ranges = []
    for part in numbers.split(","):
        match = INDICES.fullmatch(part)
        if match is None:
            raise _malformed(text)
        first, last = int(match[1]), int(match[2] or match[1])
        if last < first:
            raise _malformed(text)
        ranges.append((first, last))
    return ranges


def _malformed(text: str) -> ConfigError:
    return ConfigError(f"directions is {text!r}; {DIRECTIONS_HELP}.")
