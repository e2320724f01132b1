"""Charts: well-formed SVG whose bars are in proportion."""

from __future__ import annotations

from collections.abc import Callable
from xml.etree import ElementTree

import pytest
from markupsafe import Markup

from spmm_torch.report.charts import COLUMN_HEIGHT, WIDTH, Bar, bar_chart, histogram

Chart = Callable[[list[Bar]], Markup]
CHARTS: list[Chart] = [
    lambda bars: bar_chart(bars, "title"),
    lambda bars: histogram(bars, "axis", "title"),
]


def bars_of(*values: float) -> list[Bar]:
    """Bars of the given lengths, with labels that have to be escaped."""
    return [Bar(f"<{index}>", value, f"{value:g} & more") for index, value in enumerate(values)]


def rectangles(chart: str) -> list[dict[str, float]]:
    """Place and size of every bar of an SVG."""
    keys = ("x", "y", "width", "height")
    return [
        {key: float(node.attrib[key]) for key in keys}
        for node in ElementTree.fromstring(chart).iter("rect")
    ]


@pytest.mark.parametrize("chart", CHARTS, ids=["bars", "columns"])
@pytest.mark.parametrize("values", [(), (0.0,), (3.0,), (0.0, 0.0), tuple(range(40))])
def test_any_number_of_bars_lies_inside(chart: Chart, values: tuple[float, ...]) -> None:
    text = chart(bars_of(*values))
    boxes = rectangles(text)
    height = float(ElementTree.fromstring(text).attrib["viewBox"].split()[3])
    assert len(boxes) == len(values)
    for box in boxes:
        assert box["x"] >= 0.0 and box["y"] >= 0.0
        assert box["x"] + box["width"] <= WIDTH
        assert box["y"] + box["height"] <= height
    assert ("nothing to show" in text) == (not values)


def test_long_texts_beside_bars_are_not_cut_off() -> None:
    text = "33.4 % \u00b7 12,408 stored"
    chart = ElementTree.fromstring(bar_chart([Bar("ward", 9.0, text), Bar("b", 1.0, "1")], "title"))
    starts = [float(node.attrib["x"]) for node in chart.iter("text") if node.text == text]
    assert starts[0] + 8.0 * len(text) <= WIDTH


def test_bars_are_in_proportion() -> None:
    lengths = [box["width"] for box in rectangles(bar_chart(bars_of(1.0, 4.0, 2.0), "title"))]
    assert [length / lengths[1] for length in lengths] == pytest.approx([0.25, 1.0, 0.5], rel=0.01)
    heights = [box["height"] for box in rectangles(CHARTS[1](bars_of(1.0, 4.0, 2.0)))]
    assert heights == pytest.approx([COLUMN_HEIGHT / 4, COLUMN_HEIGHT, COLUMN_HEIGHT / 2])


def test_columns_stand_on_one_line() -> None:
    feet = {box["y"] + box["height"] for box in rectangles(CHARTS[1](bars_of(1.0, 4.0, 2.0)))}
    assert len(feet) == 1


def test_labels_of_crowded_columns_are_thinned_out() -> None:
    few = CHARTS[1](bars_of(*range(8)))
    many = CHARTS[1](bars_of(*range(60)))
    assert few.count('text-anchor="middle"') == 8 + 8 + 1
    assert many.count('text-anchor="middle"') < 40


def test_a_colour_of_its_own() -> None:
    chart = bar_chart([Bar("a", 1.0, "1", "#3062ab"), Bar("b", 1.0, "1")], "title")
    assert chart.count("fill=") == 1
    assert 'fill="#3062ab"' in chart
