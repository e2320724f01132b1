"""Errors by the polar angles of light and view."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from ..data.selection import RING_TOLERANCE

# Most rings of equal polar angle; more are merged to bands of equal width.
MAX_RINGS, BANDS = 12, 12


BAND_MIDDLES = tuple(90.0 / BANDS * (index + 0.5) for index in range(BANDS))  # in degrees


@dataclass(frozen=True)
class AngleTable:
    """Sums of squares by rings of views (rows) and of lights (columns).

    Attributes:
        view, light: polar angle of each ring, or of the middle of each band, in degrees.
        energy, error: `[rows, columns]` float64.
    """

    view: tuple[float, ...]
    light: tuple[float, ...]
    energy: Tensor
    error: Tensor

    def snr_db(self) -> Tensor:
        """SNR of each cell in decibels, `[rows, columns]`; NaN where no pair lies."""
        return 10.0 * torch.log10(self.energy / self.error)

    def error_fraction(self) -> Tensor:
        """The fraction of the error in each cell, `[rows, columns]`; NaN where no pair lies."""
        return torch.where(self.energy > 0.0, self.error / self.error.sum(), torch.nan)


def by_angle(view: Tensor, light: Tensor, energy: Tensor, error: Tensor) -> AngleTable:
    """Sums of squares by rings, of those `[D]` of pairs of views `[V, 3]` and lights `[L, 3]`."""
    (row, view_degrees), (column, light_degrees) = rings(view), rings(light)
    rows = torch.nn.functional.one_hot(row, len(view_degrees)).double()  # [V, rows]
    columns = torch.nn.functional.one_hot(column, len(light_degrees)).double()
    sums = (rows.T @ part.view(len(view), len(light)) @ columns for part in (energy, error))
    return AngleTable(view_degrees, light_degrees, *sums)


def rings(directions: Tensor) -> tuple[Tensor, tuple[float, ...]]:
    """The ring of each direction `[N]` of `[N, 3]`, and rising polar angles of rings in degrees."""
    polar = _polar(directions)
    order = polar.argsort()
    ring = torch.zeros(len(polar), dtype=torch.long)
    ring[order[1:]] = (polar[order].diff() > RING_TOLERANCE).cumsum(0)
    count = int(ring.max()) + 1
    if count > MAX_RINGS:
        return band(directions), BAND_MIDDLES
    sums = torch.zeros(count, dtype=torch.float64).index_add(0, ring, polar)
    means = (sums / torch.bincount(ring)).rad2deg()
    return ring, tuple(round(angle, 1) for angle in means.tolist())


def band(directions: Tensor) -> Tensor:
    """The band of polar angles, of equal width, of each direction `[N]` of `[N, 3]`."""
    return (_polar(directions).rad2deg() * (BANDS / 90.0)).long().clamp(max=BANDS - 1)


def _polar(directions: Tensor) -> Tensor:
    """Polar angles `[N]` float64, in radians."""
    exact = directions.double().cpu()
    return torch.atan2(exact[:, :2].norm(dim=1), exact[:, 2])
