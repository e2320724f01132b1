"""The first point at which rays meet a height field, cell by cell and without a step too long.

Heights are bilinear between texel centres, so a ray crosses cells of 2 x 2 centres. Windows of
cells that lie wholly below the ray are passed at once. In any other cell the surface along the ray
is a quadratic polynomial, and its first root is found in closed form: no peak is stepped over.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor

from .directions import REPEAT, continued

# Rays that are walked at once: their state stays in the caches of a core.
CPU_BLOCK, CUDA_BLOCK = 1 << 17, 1 << 22
# Sides, in cells, of the windows that are passed at once, in this order.
WINDOWS = (16, 4)
# Cells that a walk crosses before rays that have met the surface are sorted out.
CROSSINGS = 3
# Least speed of a ray across texels, per unit of height: slower ones stay in their cell.
SLOWEST = 1e-9
# Texels around the reach of all rays: the cell, rounding, and crossings after the hit.
MARGIN = 2 + CROSSINGS


@dataclass(frozen=True)
class Rays:
    """R lines (column, row) = at + t * speed over heights t, in texels.

    Attributes:
        column, row: at height 0, `[R]`; 0 is the centre of the first texel.
        across, down: speed, `[R]`.
    """

    column: Tensor
    row: Tensor
    across: Tensor
    down: Tensor

    def block(self, part: slice) -> Rays:
        """Consecutive rays."""
        return Rays(self.column[part], self.row[part], self.across[part], self.down[part])

    def at(self, index: Tensor) -> Rays:
        """The rays `index [n]`."""
        parts = (self.column, self.row, self.across, self.down)
        return Rays(*(part.index_select(0, index) for part in parts))


@dataclass(frozen=True)
class Cells:
    """A height map with its continuation, as far as any ray of a walk reaches.

    Attributes:
        height: heights, row after row, `[N]`.
        top: the highest point of the cell right of and below each of them, `[N]`.
        windows: the same of the squares of so many cells a side, by side.
        stride: heights of one row.
        margin: rows and columns on each side of the map itself.
        low, high: least and greatest height.
    """

    height: Tensor
    top: Tensor
    windows: dict[int, Tensor]
    stride: int
    margin: int
    low: float
    high: float

    @classmethod
    def build(cls, height: Tensor, rule: str, slope: float) -> Cells:
        """The cells of a map `[H, W]` for rays of at most `slope` texture widths per height."""
        rows, columns = height.shape
        low, high = (float(bound) for bound in torch.aminmax(height))
        margin = math.ceil(slope * max(-low, high) * columns) + MARGIN
        row, column = (
            continued(torch.arange(-margin, n + margin, device=height.device), n, rule)
            for n in (rows, columns)
        )
        wide = height[row][:, column]
        tops = {1: _highest(wide, 1)}
        while max(tops) < max(WINDOWS):
            side = max(tops)
            tops[2 * side] = _highest(tops[side], side)
        windows = {side: tops[side].flatten() for side in WINDOWS}
        return cls(wide.flatten(), tops[1].flatten(), windows, wide.shape[1], margin, low, high)


def _highest(map_: Tensor, step: int) -> Tensor:
    """The greatest of each value of a map `[h, w]` and those `step` further right and below."""
    beside = torch.maximum(map_, map_.roll(-step, 1))
    return torch.maximum(beside, beside.roll(-step, 0))


def folded(rays: Rays, rows: int, columns: int, rule: str) -> Rays:
    """Equal rays that start within the map; they run the other way in reversed copies."""
    column, across = _folded(rays.column, rays.across, columns, rule)
    row, down = _folded(rays.row, rays.down, rows, rule)
    return Rays(column, row, across, down)


def _folded(at: Tensor, speed: Tensor, count: int, rule: str) -> tuple[Tensor, Tensor]:
    """`folded` along one axis: places and speeds `[R]`."""
    edge = at + 0.5
    if rule == REPEAT:
        return torch.remainder(edge, count) - 0.5, speed
    place = torch.remainder(edge, 2 * count)
    turned = place > count
    return torch.where(turned, 2 * count - place, place) - 0.5, torch.where(turned, -speed, speed)


def first_heights(cells: Cells, rays: Rays) -> Tensor:
    """The height `[R]` at which each ray, on its way down, first meets the surface."""
    if cells.low == cells.high or not len(rays.column):
        return torch.full_like(rays.column, cells.low)
    size = CUDA_BLOCK if rays.column.is_cuda else CPU_BLOCK
    starts = range(0, len(rays.column), size)
    return torch.cat([_walk(cells, rays.block(slice(n, n + size))) for n in starts])


def _skipped(cells: Cells, rays: Rays, enter: Tensor, side: int) -> Tensor:
    """Heights `[R]` above which rays from heights `enter [R]` meet nothing.

    Rays pass windows of `side` cells as long as these lie below them.
    """
    table = cells.windows[side]
    speed = torch.maximum(rays.across.abs(), rays.down.abs()).clamp(min=SLOWEST)
    fall = (side - 1) / speed  # a window holds the cells that a ray crosses on it
    found, ray = enter, None
    while True:
        leave = (enter - fall).clamp(min=cells.low)
        column, row = (
            torch.minimum(start + enter * pace, start + leave * pace) + cells.margin
            for start, pace in ((rays.column, rays.across), (rays.row, rays.down))
        )
        highest = table.index_select(0, row.long() * cells.stride + column.long())
        clear = highest < leave
        enter = torch.where(clear, leave, torch.minimum(enter, highest))
        found = enter if ray is None else found.index_copy_(0, ray, enter)
        left = torch.nonzero(clear).squeeze(-1)
        if not len(left):
            return found
        ray = left if ray is None else ray.index_select(0, left)
        rays, fall, enter = rays.at(left), fall.index_select(0, left), enter.index_select(0, left)


def _walk(cells: Cells, rays: Rays) -> Tensor:
    """`first_heights` of one block of rays."""
    enter = torch.full_like(rays.column, cells.high)
    for side in WINDOWS:
        enter = _skipped(cells, rays, enter, side)
    found = torch.full_like(enter, cells.low)
    crossing = _Crossing.start(cells, rays, enter)
    while len(crossing.ray):
        open_ = torch.ones_like(crossing.ray, dtype=torch.bool)
        for _ in range(CROSSINGS):
            leave = crossing.leave(cells.low)
            near = torch.nonzero(crossing.reached(cells, leave) & open_).squeeze(-1)
            ray, cell, start, end = (
                part.index_select(0, near)
                for part in (crossing.ray, crossing.cell, crossing.enter, leave)
            )
            met, height = _met(cells, rays.at(ray), cell, start, end)
            found.index_copy_(0, *(part.index_select(0, met) for part in (ray, height)))
            open_.index_fill_(0, near.index_select(0, met), False)
            crossing.cross(leave)
        crossing = crossing.only(torch.nonzero(open_).squeeze(-1))
    return found


@dataclass
class _Crossing:
    """Where n rays are: each in one cell.

    Attributes:
        ray: `[n]`.
        cell: its place in `Cells.top`, `[n]`.
        enter: height at which the ray enters the cell, `[n]`.
        next_column, next_row: heights at which it crosses the next column or row, `[n]`.
        pace_column, pace_row: heights between two columns, two rows, `[n]`.
        step_column, step_row: what a crossing adds to `cell`, `[n]`.
    """

    ray: Tensor
    cell: Tensor
    enter: Tensor
    next_column: Tensor
    next_row: Tensor
    pace_column: Tensor
    pace_row: Tensor
    step_column: Tensor
    step_row: Tensor

    @classmethod
    def start(cls, cells: Cells, rays: Rays, enter: Tensor) -> _Crossing:
        """Rays at heights `enter [R]`."""
        column, next_column, pace_column, right = _axis(
            rays.column + cells.margin, rays.across, enter
        )
        row, next_row, pace_row, below = _axis(rays.row + cells.margin, rays.down, enter)
        return cls(
            torch.arange(len(enter), device=enter.device),
            row * cells.stride + column,
            enter,
            next_column,
            next_row,
            pace_column,
            pace_row,
            torch.where(right, 1, -1),
            torch.where(below, cells.stride, -cells.stride),
        )

    def leave(self, low: float) -> Tensor:
        """The height at which each ray leaves its cell, `[n]`."""
        return torch.maximum(self.next_column, self.next_row).clamp(min=low)

    def reached(self, cells: Cells, leave: Tensor) -> Tensor:
        """Whether the cell of each ray is as high as the ray where it leaves, `[n]` bool."""
        return cells.top.index_select(0, self.cell) >= leave

    def cross(self, leave: Tensor) -> None:
        """Moves all rays to their next cells, which they enter at `leave [n]`."""
        aside = self.next_column >= self.next_row
        self.cell = self.cell + torch.where(aside, self.step_column, self.step_row)
        self.next_column = self.next_column - self.pace_column * aside
        self.next_row = self.next_row - self.pace_row * ~aside
        self.enter = leave

    def only(self, index: Tensor) -> _Crossing:
        """Some of the rays, by their places `[n']`."""
        return _Crossing(*(part.index_select(0, index) for part in vars(self).values()))


def _axis(start: Tensor, speed: Tensor, enter: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """The crossings of rays along one axis, `[R]` each.

    Returns:
        (cell, height of the next line, heights between lines, whether cells come in their order).
    """
    at = start + enter * speed
    cell = torch.floor(at)
    forward = speed < 0.0  # heights fall on the way
    gap = torch.where(forward, cell + 1.0 - at, at - cell)
    pace = 1.0 / speed.abs().clamp(min=SLOWEST)
    return cell.long(), enter - gap * pace, pace, forward


def _met(
    cells: Cells, rays: Rays, cell: Tensor, enter: Tensor, leave: Tensor
) -> tuple[Tensor, Tensor]:
    """Which of n rays meet the surface within their cells `[m]`, and at which height `[n]`.

    The surface less the ray is g(l) = g0 + (g1 - g0 - q) l + q l^2, l from 0 to 1 within the cell.
    """
    row = torch.div(cell, cells.stride, rounding_mode="floor")
    x0 = rays.column + (cells.margin - (cell - row * cells.stride))
    y0 = rays.row + (cells.margin - row)
    a, b, c, d = (
        cells.height.index_select(0, cell + shift)
        for shift in (0, 1, cells.stride, cells.stride + 1)
    )
    right, below, twist = b - a, c - a, a - b - c + d

    def gap(t: Tensor) -> Tensor:
        x, y = x0 + t * rays.across, y0 + t * rays.down
        return a + right * x + (below + twist * x) * y - t

    fall = leave - enter
    first, last = gap(enter), gap(leave)
    curve = twist * (rays.across * fall) * (rays.down * fall)
    slope = last - first - curve
    root = slope * slope - 4.0 * curve * first
    share = -2.0 * first / (slope + root.clamp(min=0.0).sqrt())
    inside = (root >= 0.0) & (share >= 0.0) & (share <= 1.0)
    share = torch.where(first >= 0.0, 0.0, torch.where(inside, share, 1.0))
    # The least height is met for certain; rounding must not lead a ray past it.
    met = inside | (first >= 0.0) | (last >= 0.0) | (leave <= cells.low)
    return torch.nonzero(met).squeeze(-1), enter + share * fall
