"""Functions on the unit square that vary with a few parameters, as RGL `.bsdf` files hold them.

A table has nodes at equal steps from 0 to 1 along y and x, and one such slice for each combination
of parameters. Between nodes and parameters it is interpolated linearly; beyond the first and last
parameter it stays as it is there.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

TINY = np.finfo(np.float64).tiny  # in place of the mass of a row that is all zero


@dataclass(frozen=True)
class Slices:
    """A table and its parameters.

    Attributes:
        values: `[..., Y, X]`, one leading axis for each parameter.
        parameters: ascending values of each parameter.
    """

    values: np.ndarray
    parameters: tuple[np.ndarray, ...] = ()

    def eval(self, u: np.ndarray, at: Sequence[np.ndarray] = ()) -> np.ndarray:
        """Values `[Q]` at points.

        Args:
            u: points (x, y) of the unit square, `[Q, 2]`.
            at: each parameter, `[Q]`.
        """
        row, column, across, up = self._patch(u)
        v00, v10, v01, v11 = self._corners(self.values, row, column, at)
        return (1 - up) * ((1 - across) * v00 + across * v10) + up * (
            (1 - across) * v01 + across * v11
        )

    def invert(self, u: np.ndarray, at: Sequence[np.ndarray]) -> np.ndarray:
        """The numbers `[Q, 2]` in [0, 1] from which sampling by this density makes `u [Q, 2]`.

        Rows are drawn by their mass, then x within the row: the Rosenblatt transform of the density
        that is linear between nodes [DJ18]. Each slice has mass 1 before slices are mixed.
        """
        density, within, below = self._normalized()
        row, column, across, up = self._patch(u)
        v00, v10, v01, v11 = self._corners(density, row, column, at)
        left, right = (1 - up) * v00 + up * v01, (1 - up) * v10 + up * v11
        w00, _, w01, _ = self._corners(within, row, column, at)
        end = np.full_like(column, self.values.shape[-1] - 2)
        _, r0, _, r1 = self._corners(within, row, end, at)
        under = self._at(below[..., None], row, np.zeros_like(row), at)
        x = (1 - up) * w00 + up * w01 + across * (left + 0.5 * across * (right - left))
        y = under + up * (r0 + 0.5 * up * (r1 - r0))
        mass = (1 - up) * r0 + up * r1
        return np.stack((x / np.maximum(mass, TINY), y), axis=1)

    def _normalized(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Values `[..., Y, X]`, their sums left of a node, and sums `[..., Y]` of rows below one.

        All are parts of the mass of their slice, counted in steps between nodes.
        """
        steps = 0.5 * (self.values[..., 1:] + self.values[..., :-1])
        within = np.concatenate((np.zeros_like(steps[..., :1]), np.cumsum(steps, -1)), -1)
        rows = within[..., -1]  # [..., Y]
        steps = 0.5 * (rows[..., 1:] + rows[..., :-1])
        below = np.concatenate((np.zeros_like(steps[..., :1]), np.cumsum(steps, -1)), -1)
        mass = np.maximum(below[..., -1:], TINY)
        return self.values / mass[..., None], within / mass[..., None], below / mass

    def _patch(self, u: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Row and column of the patch of points `u [Q, 2]`, and where in it they lie, all `[Q]`."""
        rows, columns = self.values.shape[-2:]
        x, y = u[:, 0] * (columns - 1), u[:, 1] * (rows - 1)
        column = np.clip(x.astype(int), 0, columns - 2)
        row = np.clip(y.astype(int), 0, rows - 2)
        return row, column, x - column, y - row

    def _corners(
        self, table: np.ndarray, row: np.ndarray, column: np.ndarray, at: Sequence[np.ndarray]
    ) -> tuple[np.ndarray, ...]:
        """Entries `[Q]` at the corners (00, 10, 01, 11) of patches, x first."""
        return tuple(
            self._at(table, row + up, column + across, at) for up in (0, 1) for across in (0, 1)
        )

    def _at(
        self, table: np.ndarray, row: np.ndarray, column: np.ndarray, at: Sequence[np.ndarray]
    ) -> np.ndarray:
        """Entries `[Q]` of `table [..., Y, X]`, interpolated over the parameters."""
        near = [_between(known, value) for known, value in zip(self.parameters, at, strict=True)]
        total = np.zeros(len(row))
        for sides in itertools.product((0, 1), repeat=len(near)):
            weight = np.ones(len(row))
            place = []
            for side, (index, share, last) in zip(sides, near, strict=True):
                weight = weight * (share if side else 1.0 - share)
                place.append(np.minimum(index + side, last))
            total += weight * table[(*place, row, column)]
        return total


def _between(known: np.ndarray, value: np.ndarray) -> tuple[np.ndarray, np.ndarray, int]:
    """The known value at or before each `value [Q]`, the part of the next one, the last index."""
    last = len(known) - 1
    index = np.clip(np.searchsorted(known, value, side="right") - 1, 0, max(last - 1, 0))
    if last == 0:
        return index, np.zeros(len(value)), last
    step = known[index + 1] - known[index]
    return index, np.clip((value - known[index]) / step, 0.0, 1.0), last
