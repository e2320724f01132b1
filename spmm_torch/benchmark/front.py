"""The Pareto front: what nothing else beats in both cost and quality."""

from __future__ import annotations

from collections.abc import Sequence


def pareto_front(costs: Sequence[float], qualities: Sequence[float]) -> list[bool]:
    """Whether each point is on the front: no other has both less cost and no less quality.

    Of points alike in both, all or none are on it.
    """
    points = list(zip(costs, qualities, strict=True))
    return [not any(_dominates(other, point) for other in points) for point in points]


def _dominates(one: tuple[float, float], other: tuple[float, float]) -> bool:
    return one != other and one[0] <= other[0] and one[1] >= other[1]
