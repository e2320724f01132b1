"""The Pareto front of cost and quality."""

from __future__ import annotations

from collections.abc import Sequence


def pareto_front(qualities: Sequence[float], *costs: Sequence[float]) -> list[bool]:
    """Whether each point is on the front: no other is better in one value and worse in none.

    Equal points are all on it, or none is.

    Args:
        qualities: of the points; higher is better.
        costs: of the points, one kind or several; lower is better.
    """
    points = [(-quality, *cost) for quality, *cost in zip(qualities, *costs, strict=True)]
    return [not any(_dominates(other, point) for other in points) for point in points]


def _dominates(one: tuple[float, ...], other: tuple[float, ...]) -> bool:
    return one != other and all(a <= b for a, b in zip(one, other, strict=True))
