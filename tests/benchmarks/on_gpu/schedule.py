"""The seconds that each part may take: together less than six minutes, whatever happens."""

from __future__ import annotations

# What is most worth knowing comes first. What a part saves, the next one may use.
LIMITS = {
    "speed": 20,
    "agreement": 45,
    "sample": 40,
    "full": 80,
    "triples": 15,
    "rendering": 20,
    "sampling": 15,
    "training": 15,
    "mitsuba": 20,
    "small": 30,
    "tests": 45,
}
TOTAL = 360
# Seconds to end a part that hangs, at most, and to write the results.
GRACE, WRITING = 6, 5


def seconds_for(parts: list[str], spent: float) -> float:
    """The limit of the first of the `parts` that are left, after so many seconds.

    Later parts keep theirs, and the grace of each.
    """
    later = sum(LIMITS[part] for part in parts[1:])
    left = TOTAL - WRITING - GRACE - spent - later
    return max(0.0, min(left, TOTAL))
