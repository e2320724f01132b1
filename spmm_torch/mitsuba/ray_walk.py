"""The point of a relief that a view shows: the twin of `geometry.ray_walk`, ray by ray."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import torch

from ..geometry.directions import REPEAT
from ..geometry.ray_walk import SLOWEST, WINDOWS
from ..geometry.relief import HeightField
from . import arrays
from .arrays import SMALLEST, float_array, loop, one
from .libraries import dr, mi
from .texels import remainder

# Numbers of a row of `Walk.cells`.
CELL = 8


@dataclass(frozen=True)
class Ray:
    """A line (column, row) = at + t * speed over heights t, in texels of the widened map."""

    column: Any
    row: Any
    across: Any
    down: Any


@dataclass(frozen=True)
class Walk:
    """A height map on which rays are walked.

    Attributes:
        field: heights over the texels.
        cells: heights of the four corners of each cell, its highest point, and three numbers that
            are not used, `[N, CELL]`: one read a cell.
        windows: its windows, by side.
    """

    field: HeightField
    cells: Any
    windows: dict[int, Any]

    @classmethod
    def build(cls, field: HeightField) -> Walk:
        """The arrays of a field of heights."""
        cells = field.cells
        windows = {side: float_array(table) for side, table in cells.windows.items()}
        right, below, across = (
            cells.height.roll(-shift) for shift in (1, cells.stride, cells.stride + 1)
        )
        columns = torch.stack((cells.height, right, below, across, cells.top), dim=1)
        rows = torch.nn.functional.pad(columns, (0, CELL - columns.shape[1]))
        return cls(field, float_array(rows), windows)

    def hit(self, uv: Any, wo: Any) -> Any:
        """uv of the surface point that the view wo shows at uv of the plane; v runs up."""
        cells, (rows, columns) = self.field.cells, self.field.height.shape
        if cells.low == cells.high == 0.0:
            return uv
        length = dr.sqrt(wo.x * wo.x + wo.y * wo.y)
        down = dr.maximum(dr.maximum(wo.z, length / self.field.slope), SMALLEST)
        shift = mi.Vector2f(wo.x / down, wo.y / down * (columns / rows))
        if cells.low == cells.high:
            return uv + cells.low * shift
        column, across = self._folded(uv.x * columns - 0.5, shift.x * columns, columns)
        row, below = self._folded((1.0 - uv.y) * rows - 0.5, -shift.y * rows, rows)
        places = (column + cells.margin, row + cells.margin, across, below)
        ray = Ray(*(dr.detach(part) for part in places))  # the place of a hit has no gradient
        return uv + self._first_height(ray) * shift

    def _folded(self, at: Any, speed: Any, count: int) -> tuple[Any, Any]:
        """A place within the map and the speed there, which reversed copies turn."""
        edge = at + 0.5
        # Rounding of a far place must not lead beyond the map.
        if self.field.rule == REPEAT:
            return dr.clip(remainder(edge, count), 0.0, count) - 0.5, speed
        place = dr.clip(remainder(edge, 2.0 * count), 0.0, 2.0 * count)
        turned = place > count
        place = dr.select(turned, 2.0 * count - place, place)
        return place - 0.5, dr.select(turned, -speed, speed)

    def _first_height(self, ray: Ray) -> Any:
        """The height at which a ray, on its way down, first meets the surface."""
        enter = mi.Float(self.field.cells.high) + 0.0 * ray.column
        for side in WINDOWS:
            enter = self._skipped(ray, enter, side)
        return self._walked(ray, enter)

    def _skipped(self, ray: Ray, enter: Any, side: int) -> Any:
        """A height above which a ray meets nothing; windows that lie below it are passed."""
        cells, table = self.field.cells, self.windows[side]
        speed = dr.maximum(dr.maximum(dr.abs(ray.across), dr.abs(ray.down)), SLOWEST)
        fall = (side - 1) / speed

        def passed(enter: Any, clear: Any) -> tuple[Any, Any]:
            leave = dr.maximum(enter - fall, cells.low)
            column, row = (
                mi.UInt32(dr.minimum(start + enter * pace, start + leave * pace))
                for start, pace in ((ray.column, ray.across), (ray.row, ray.down))
            )
            highest = one(table, row * cells.stride + column)
            clear = highest < leave
            return dr.select(clear, leave, dr.minimum(enter, highest)), clear

        return loop((enter, mi.Bool(True)), lambda enter, clear: clear, passed)[0]

    def _walked(self, ray: Ray, enter: Any) -> Any:
        """The height of the hit of a ray that is at height `enter`."""
        cells = self.field.cells
        column, next_column, pace_column, right = _axis(ray.column, ray.across, enter)
        row, next_row, pace_row, below = _axis(ray.row, ray.down, enter)

        def crossed(
            column: Any, row: Any, next_column: Any, next_row: Any, enter: Any, met: Any
        ) -> tuple[Any, ...]:
            leave = dr.maximum(dr.maximum(next_column, next_row), cells.low)
            inside, height = self._met(ray, column, row, enter, leave)
            aside = next_column >= next_row
            return (
                dr.select(aside, column + right, column),
                dr.select(aside, row, row + below),
                dr.select(aside, next_column - pace_column, next_column),
                dr.select(aside, next_row, next_row - pace_row),
                dr.select(inside, height, leave),
                inside,
            )

        state = (column, row, next_column, next_row, enter, mi.Bool(False))
        return loop(state, lambda c, r, nc, nr, e, met: met ^ True, crossed)[4]

    def _met(self, ray: Ray, column: Any, row: Any, enter: Any, leave: Any) -> tuple[Any, Any]:
        """Whether a ray meets the surface within its cell, and at which height."""
        cells = self.field.cells
        cell = mi.UInt32(row * cells.stride + column)
        x0, y0 = ray.column - column, ray.row - row
        a, b, c, d, top = arrays.row(self.cells, cell, CELL)[:5]
        right, below, twist = b - a, c - a, a - b - c + d

        def gap(t: Any) -> Any:
            x, y = x0 + t * ray.across, y0 + t * ray.down
            return a + right * x + (below + twist * x) * y - t

        fall = leave - enter
        first, last = gap(enter), gap(leave)
        curve = twist * (ray.across * fall) * (ray.down * fall)
        slope = last - first - curve
        root = slope * slope - 4.0 * curve * first
        divisor = slope + dr.sqrt(dr.maximum(root, 0.0))
        share = dr.select(divisor != 0.0, -2.0 * first / divisor, -1.0)
        inside = (root >= 0.0) & (share >= 0.0) & (share <= 1.0)
        share = dr.select(first >= 0.0, 0.0, dr.select(inside, share, 1.0))
        # A cell that is lower than the ray cannot be met; the least height is, for certain.
        met = (inside | (first >= 0.0) | (last >= 0.0) | (leave <= cells.low)) & (top >= leave)
        return met, enter + share * fall


def _axis(start: Any, speed: Any, enter: Any) -> tuple[Any, Any, Any, Any]:
    """(cell, height of the next line, heights between lines, step) of a ray along one axis."""
    at = start + enter * speed
    cell = dr.floor(at)
    forward = speed < 0.0  # heights fall on the way
    gap = dr.select(forward, cell + 1.0 - at, at - cell)
    pace = 1.0 / dr.maximum(dr.abs(speed), SLOWEST)
    return mi.Int32(cell), enter - gap * pace, pace, dr.select(forward, 1, -1)
