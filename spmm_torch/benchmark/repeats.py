"""Most repeats of a measurement; a module of its own, so that help texts do not load torch."""

from __future__ import annotations

FULL_REPEATS, SMALL_REPEATS = 3, 2
