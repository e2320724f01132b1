"""Squared errors of a fit, and their ratios in decibels."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass


@dataclass(frozen=True)
class Totals:
    """Sums of squares over texels, direction pairs and channels.

    Attributes:
        energy: sum of squared values.
        without_residual: sum of squared errors of the lobes alone.
        with_residual: sum of squared errors of the whole model, with the residual as stored.
        cluster_mean: sum of squared errors of the mean of each cluster, without any model; NaN
            where texels share no pairs.
    """

    energy: float
    without_residual: float
    with_residual: float
    cluster_mean: float

    def row(self) -> tuple[float, float, float, float]:
        """The four sums in the order of the fields, so that `Totals(*row)` is the same."""
        return self.energy, self.without_residual, self.with_residual, self.cluster_mean

    def snr_db(self) -> dict[str, float]:
        """Signal-to-noise ratios in dB, by the name of the error."""
        names = ("without_residual", "with_residual", "cluster_mean")
        return {name: snr_db(self.energy, getattr(self, name)) for name in names}

    def times(self, factor: float) -> Totals:
        """The four sums times a factor."""
        return Totals(*(factor * value for value in self.row()))

    @staticmethod
    def sum(parts: Iterable[Totals]) -> Totals:
        """The sums over all parts."""
        columns = zip(*(part.row() for part in parts), strict=True)
        return Totals(*(math.fsum(column) for column in columns))


def snr_db(energy: float, error: float) -> float:
    """The ratio 10 log10(sum y^2 / sum e^2) in dB; infinite for no error, -infinite for black."""
    return _decibels(energy, error)


def psnr_db(peak: float, error: float, count: int) -> float:
    """The ratio 10 log10(peak^2 / mean e^2) in dB of `count` values; infinite for a perfect fit."""
    return _decibels(peak * peak * count, error)


def _decibels(signal: float, error: float) -> float:
    if error <= 0.0:
        return math.inf
    ratio = signal / error
    return -math.inf if ratio == 0.0 else 10.0 * math.log10(ratio)
