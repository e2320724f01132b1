"""Numbers as people read them."""

from __future__ import annotations

import math
from collections.abc import Callable

import pytest

from spmm_torch.report import wording

CASES = [
    (wording.decibels, 7.314, "7.31 dB"),
    (wording.decibels, -0.5, "−0.50 dB"),
    (wording.decibels, math.inf, "exact"),
    (wording.decibels, math.nan, "–"),
    (wording.size, 812, "812 bytes"),
    (wording.size, 32 * 81**2 * 3 * 4, "2.40 MB"),
    (wording.size, 256**2 * 81**2 * 3, "1.20 GB"),
    (wording.size, 80_000, "78.1 kB"),
    (wording.three_figures, 9.996, "10.0"),
    (wording.three_figures, 99.96, "100"),
    (wording.three_figures, 12345.6, "12,346"),
    (wording.seconds, 0.044, "0.04 s"),
    (wording.seconds, 42.06, "42.1 s"),
    (wording.seconds, 185.0, "3 min 05 s"),
    (wording.ratio, 98.4, "1:98"),
    (wording.times_smaller, 37.4, "37 times smaller"),
    (wording.times_smaller, 0.4, "2.5 times larger"),
    (wording.ratio, 3.14159, "1:3.1"),
    (wording.short_seconds, 0.0844, "84.4 ms"),
    (wording.short_seconds, 42.06, "42.1 s"),
    (wording.percent, 0.1234, "12.3 %"),
    (wording.number, 12345, "12,345"),
    (wording.number, 6.534, "6.53"),
]


@pytest.mark.parametrize(("function", "value", "text"), CASES)
def test_wording(function: Callable[[float], str], value: float, text: str) -> None:
    assert function(value) == text


@pytest.mark.parametrize(
    "function",
    [
        wording.decibels,
        wording.size,
        wording.seconds,
        wording.ratio,
        wording.number,
        wording.percent,
        lambda value: wording.fixed(value, 2),
    ],
)
def test_what_is_not_known_is_a_dash(function: Callable[[float | None], str]) -> None:
    assert function(None) == "–"


def test_plural() -> None:
    assert wording.plural(1, "cluster") == "1 cluster"
    assert wording.plural(4096, "texel") == "4,096 texels"


def test_fixed_decimals() -> None:
    assert wording.fixed(-0.125, 2) == "−0.12"
    assert wording.fixed(math.inf, 2) == wording.fixed(math.nan, 2) == "–"


@pytest.mark.parametrize(
    ("runs", "text"), [(1, "2.0 s"), (5, "2.0 s ± 25 %")], ids=["one run", "five runs"]
)
def test_the_range_is_that_of_several_runs(runs: int, text: str) -> None:
    times = {"median": 2.0, "fastest": 1.5, "slowest": 2.5, "runs": runs}
    assert wording.median_time(times) == text
