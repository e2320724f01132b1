"""How often a benchmark repeats a measurement, at most; help texts tell it without torch."""

from __future__ import annotations

FULL_REPEATS, SMALL_REPEATS = 3, 2
