"""Heat maps: every number stands in its cell, and colours follow the numbers."""

from __future__ import annotations

import math

import numpy as np
import pytest

from spmm_torch.report.heat_map import UNKNOWN_COLOUR, Axis, heat_map, scaled
from spmm_torch.report.pictures import css_colour, heat_colours
from tests.report.test_page import Page

ROWS, COLUMNS = Axis("view", ["0°", "30°"]), Axis("light", ["0°", "45°", "60°"])


def test_numbers_and_colours() -> None:
    values = [[1.0, 5.0, 9.0], [3.0, math.nan, math.inf]]
    texts = [["one", "five", "nine"], ["three", "a", "b"]]
    page = Page(heat_map(values, texts, ROWS, COLUMNS, "a title"))
    assert {"one", "five", "nine", "three", "view", "light", "a title", "45°"} <= set(page.text)
    colours = [given["fill"] for name, given in page.elements if name == "rect"]
    steps = heat_colours(256)
    assert colours[0] == css_colour(steps[0])
    assert colours[2] == css_colour(steps[-1])
    assert colours[4:] == [UNKNOWN_COLOUR, UNKNOWN_COLOUR]


@pytest.mark.parametrize(
    ("values", "expected"),
    [([[2.0, 4.0]], [[0.0, 1.0]]), ([[7.0, 7.0]], [[0.5, 0.5]]), ([[math.inf]], [[math.nan]])],
)
def test_scale(values: list[list[float]], expected: list[list[float]]) -> None:
    np.testing.assert_equal(scaled(np.array(values)), np.array(expected))
