"""The Pareto front."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from spmm_torch.benchmark.front import pareto_front

POINTS = st.lists(st.tuples(st.integers(0, 9), st.integers(0, 9)), max_size=12)


def test_a_known_front() -> None:
    costs, qualities = [1, 2, 3, 3, 9, 2], [1, 5, 4, 5, 9, 5]
    assert pareto_front(qualities, costs) == [True, True, False, False, True, True]


def test_a_point_that_is_cheap_in_one_of_two_costs_is_on_their_front() -> None:
    seconds, size, qualities = [1, 9, 9, 2], [9, 1, 9, 9], [5, 5, 5, 4]
    assert pareto_front(qualities, seconds, size) == [True, True, False, False]


@given(POINTS)
def test_what_is_off_the_front_is_beaten_by_what_is_on_it(points: list[tuple[int, int]]) -> None:
    on = pareto_front([quality for _, quality in points], [cost for cost, _ in points])
    front = [point for point, chosen in zip(points, on, strict=True) if chosen]
    assert bool(front) == bool(points)
    for point, chosen in zip(points, on, strict=True):
        beaten = any(f != point and f[0] <= point[0] and f[1] >= point[1] for f in front)
        assert beaten != chosen
