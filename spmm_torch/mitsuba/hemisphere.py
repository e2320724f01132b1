"""Measured directions around any other one: the twin of `geometry.hemisphere`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import torch

from ..geometry.hemisphere import EDGE_TOLERANCE, MAP_SIZE, HemisphereInterpolation
from .arrays import float_array, index_array, loop, one, row
from .libraries import dr, mi

# Numbers of a cell: its matrix, whether its third corner has a value, and its corners.
CELL = 16
# Three measured directions around another, and their weights.
Around = tuple[list[Any], list[Any]]


@dataclass(frozen=True)
class Mesh:
    """The cells between measured directions.

    Attributes:
        cells: `[F, CELL]`.
        candidates: 1 + the cells that overlap each square of the map, the likeliest first, 0 for
            none, `[MAP_SIZE * MAP_SIZE, rank]`.
        directions: unit vectors `[N, 4]`, the last number unused.
        rank: candidates of a square.
        count: directions, N.
        covers: whether the cells hold all directions of the upper hemisphere.
    """

    cells: Any
    candidates: Any
    directions: Any
    rank: int
    count: int
    covers: bool

    @classmethod
    def build(cls, mesh: HemisphereInterpolation) -> Mesh:
        """The arrays of a mesh."""
        count = mesh.inverse.shape[1]
        cells = torch.zeros(max(count, 1), CELL)
        cells[:count, :9] = mesh.inverse.T
        cells[:count, 9] = mesh.third
        cells[:count, 10:13] = mesh.triangles.float()  # whole numbers, exact up to 2^24
        directions = torch.nn.functional.pad(mesh.directions.float(), (0, 1))
        return cls(
            float_array(cells),
            index_array((mesh.candidates + 1).T),
            float_array(directions),
            len(mesh.candidates),
            len(directions),
            mesh.covers,
        )

    def around(self, w: Any) -> Around:
        """Three measured directions around w, and their weights, which sum to 1.

        Of directions under the horizon they are numbers without a meaning.
        """
        held, cell = self._located(dr.detach(w))
        numbers = row(self.cells, cell, CELL)
        parts = _corner_weights(numbers, _barycentric(numbers, w))
        total = parts[0] + parts[1] + parts[2]
        scale = 1.0 / dr.select(held, total, 1.0)
        corners, weights = [mi.UInt32(n) for n in numbers[10:13]], [p * scale for p in parts]
        if self.covers:
            return corners, weights
        nearest, alone = self._nearest(dr.detach(w), held), (1.0, 0.0, 0.0)
        corners = [dr.select(held, corner, nearest) for corner in corners]
        return corners, [dr.select(held, *each) for each in zip(weights, alone, strict=True)]

    def _located(self, w: Any) -> tuple[Any, Any]:
        """(whether a cell holds w, the cell)."""
        first = self.rank * _square(w)

        def better(rank: Any, best: Any, margin: Any) -> tuple[Any, Any, Any]:
            candidate = one(self.candidates, first + rank)
            cell = dr.maximum(candidate, 1) - 1
            numbers = row(self.cells, cell, CELL)
            raw = _barycentric(numbers, w)
            parts = _corner_weights(numbers, raw)
            least = dr.minimum(dr.minimum(raw[0], raw[1]), raw[2])
            counts = (candidate > 0) & (parts[0] + parts[1] + parts[2] > EDGE_TOLERANCE)
            better = counts & (least > margin)
            rank = dr.select(candidate > 0, rank + 1, self.rank)  # none comes after
            return rank, dr.select(better, cell, best), dr.select(better, least, margin)

        start = (mi.UInt32(0), mi.UInt32(0), mi.Float(-dr.inf))
        _, cell, margin = loop(
            start, lambda rank, best, margin: (rank < self.rank) & (margin < 0.0), better
        )
        return margin > -EDGE_TOLERANCE, cell

    def _nearest(self, w: Any, held: Any) -> Any:
        """The measured direction nearest to w, sought where no cell holds w over the horizon."""

        def nearer(n: Any, best: Any, most: Any) -> tuple[Any, Any, Any]:
            x, y, z, _ = row(self.directions, n, 4)
            cosine = x * w.x + y * w.y + z * w.z
            return n + 1, dr.select(cosine > most, n, best), dr.maximum(cosine, most)

        first = dr.select(held | (w.z < 0.0), mi.UInt32(self.count), mi.UInt32(0))
        start = (first, mi.UInt32(0), mi.Float(-2.0))
        return loop(start, lambda n, best, most: n < self.count, nearer)[1]


@dataclass(frozen=True)
class Pairs:
    """The nine measured pairs around a query.

    Attributes:
        lights: measured lights, L; the number of a pair is view * L + light.
        view, light: measured directions, three each.
        view_weight, light_weight: three each.
    """

    lights: int
    view: Sequence[Any]
    light: Sequence[Any]
    view_weight: Sequence[Any]
    light_weight: Sequence[Any]

    COUNT: ClassVar = 9
    VIEWS: ClassVar = 3
    PARTS: ClassVar = 12

    @classmethod
    def build(cls, count: int, lights: Around, views: Around, factor: Any) -> Pairs:
        """The pairs of lights, of `count` measured ones, and views, with weights times a factor."""
        weights = [weight * factor for weight in lights[1]]
        return cls(count, views[0], lights[0], views[1], weights)

    def parts(self) -> tuple[Any, ...]:
        """All numbers, for the state of a loop."""
        return *self.view, *self.light, *self.view_weight, *self.light_weight

    def with_parts(self, parts: Sequence[Any]) -> Pairs:
        """The same measured directions with other `parts`."""
        return Pairs(self.lights, parts[0:3], parts[3:6], parts[6:9], parts[9:12])

    def turned(self) -> Pairs:
        """The same pairs, with the next view as the first."""
        views, weights = ([*three[1:], three[0]] for three in (self.view, self.view_weight))
        return Pairs(self.lights, views, self.light, weights, self.light_weight)

    def of_first_view(self) -> list[tuple[Any, Any]]:
        """(pair, weight) of the first view with each light."""
        first, weight = self.view[0] * self.lights, self.view_weight[0]
        lights = zip(self.light, self.light_weight, strict=True)
        return [(first + light, weight * share) for light, share in lights]

    def of(self, n: Any) -> tuple[Any, Any]:
        """(pair, weight) number n, from 0 to 8."""
        across = n // 3
        along = n - 3 * across
        pair = _chosen(across, self.view) * self.lights + _chosen(along, self.light)
        return pair, _chosen(across, self.view_weight) * _chosen(along, self.light_weight)


def _chosen(n: Any, three: Sequence[Any]) -> Any:
    """One of three numbers."""
    return dr.select(n == 0, three[0], dr.select(n == 1, three[1], three[2]))


def _square(w: Any) -> Any:
    """The map's square of a direction."""
    scale = dr.rsqrt(1.0 + dr.maximum(w.z, 0.0))
    column, row = (
        mi.UInt32(dr.clip((x * scale + 1.0) * (0.5 * MAP_SIZE), 0.0, MAP_SIZE - 1.0))
        for x in (w.x, w.y)
    )
    return row * MAP_SIZE + column


def _barycentric(m: list[Any], w: Any) -> list[Any]:
    """Three weights of w in the cell of numbers m, not normalized."""
    return [m[k] * w.x + m[k + 1] * w.y + m[k + 2] * w.z for k in (0, 3, 6)]


def _corner_weights(m: list[Any], raw: list[Any]) -> list[Any]:
    """Weights without negative parts, and without that of a corner that has no value."""
    first, second, third = (dr.maximum(part, 0.0) for part in raw)
    return [first, second, third * m[9]]
