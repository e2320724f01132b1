"""Axes of plots: positions of values, and ticks at round values."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

# Free space at both ends, as a fraction of the span of the values.
MARGIN = 0.06
TICKS, FEWEST = 6, 3
# Steps between the ticks of a linear axis, and ticks within a decade from fine to coarse.
LINEAR_STEPS = (1.0, 2.0, 5.0)
DECADE_PLACES = ((1.0, 2.0, 5.0), (1.0, 3.0), (1.0,))


@dataclass(frozen=True)
class Scale:
    """Maps values to positions.

    Attributes:
        low, high: values at the ends of the axis; their log10 on a logarithmic axis.
        start, stop: positions of the ends.
        log: whether the axis is logarithmic.
    """

    low: float
    high: float
    start: float
    stop: float
    log: bool

    @classmethod
    def over(cls, values: Sequence[float], start: float, stop: float, log: bool) -> Scale:
        """The scale that holds all `values`, with a margin."""
        inner = [math.log10(value) if log else value for value in values]
        low, high = min(inner), max(inner)
        span = (high - low) or max(abs(high), 1.0) * 0.5
        return cls(low - MARGIN * span, high + MARGIN * span, start, stop, log)

    def __call__(self, value: float) -> float:
        """The position of a value."""
        inner = math.log10(value) if self.log else value
        return self.start + (inner - self.low) / (self.high - self.low) * (self.stop - self.start)

    def ticks(self) -> list[float]:
        """Round values along the axis."""
        if not self.log:
            return _linear_ticks(self.low, self.high)
        ticks = self._log_ticks()
        # Less than a decade holds too few ticks; equal steps give more.
        return ticks if len(ticks) >= FEWEST else _linear_ticks(10.0**self.low, 10.0**self.high)

    def _log_ticks(self) -> list[float]:
        """Ticks of the finest kind that are not too many, else of the coarsest."""
        decades = range(math.floor(self.low), math.ceil(self.high) + 1)
        ticks: list[float] = []
        for places in DECADE_PLACES:
            ticks = [place * 10.0**decade for decade in decades for place in places]
            ticks = [tick for tick in ticks if self.low <= math.log10(tick) <= self.high]
            if len(ticks) <= TICKS + 1:
                break
        return ticks


def _linear_ticks(low: float, high: float) -> list[float]:
    rough = (high - low) / TICKS
    power = 10.0 ** math.floor(math.log10(rough))
    step = next((s * power for s in LINEAR_STEPS if s * power >= rough), 10.0 * power)
    first, last = math.ceil(low / step), math.floor(high / step)
    return [round(index * step, 12) for index in range(first, last + 1)]


def tick_text(value: float) -> str:
    """The value of a tick, short: `0.5`, `4k`, `1.5M`."""
    for unit, letter in ((1e9, "G"), (1e6, "M"), (1e3, "k")):
        if abs(value) >= unit:
            return f"{value / unit:g}{letter}"
    return f"{value:g}".replace("-", "−")
