"""Squared errors of a fit, and what they are in decibels."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass


@dataclass(frozen=True)
class Totals:
    """Sums of squares over texels, direction pairs and channels.

    Attributes:
        energy: of the values.
        without_residual: of the errors of lobes alone.
        with_residual: of the errors of the whole model, the residual as it is stored.
        cluster_mean: of the errors that the bare mean of each cluster would leave.
    """

    energy: float
    without_residual: float
    with_residual: float
    cluster_mean: float

    def row(self) -> tuple[float, float, float, float]:
        """All four in their order; `Totals(*row)` takes them back."""
        return self.energy, self.without_residual, self.with_residual, self.cluster_mean

    def snr_db(self) -> dict[str, float]:
        """Signal-to-noise ratios by the name of each error."""
        names = ("without_residual", "with_residual", "cluster_mean")
        return {name: snr_db(self.energy, getattr(self, name)) for name in names}

    @staticmethod
    def sum(parts: Iterable[Totals]) -> Totals:
        """The totals of all parts together."""
        columns = zip(*(part.row() for part in parts), strict=True)
        return Totals(*(math.fsum(column) for column in columns))


def snr_db(energy: float, error: float) -> float:
    """10 log10(sum y^2 / sum e^2); infinite for a perfect fit."""
    return math.inf if error <= 0.0 else 10.0 * math.log10(energy / error)


def psnr_db(peak: float, error: float, count: int) -> float:
    """10 log10(peak^2 / mean e^2) of `count` values; infinite for a perfect fit."""
    return math.inf if error <= 0.0 else 10.0 * math.log10(peak * peak * count / error)
