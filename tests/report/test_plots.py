"""Plots: well-formed SVG whose marks are where their values say."""

from __future__ import annotations

import math
from collections.abc import Sequence
from importlib.resources import files
from xml.etree import ElementTree

import pytest

from spmm_torch.report.plots import (
    BOTTOM,
    HEIGHT,
    LEFT,
    LOOKS,
    RIGHT,
    TOP,
    WIDTH,
    Axis,
    Point,
    Series,
    plot,
)
from spmm_torch.report.scales import Scale, tick_text

LINEAR, LOG = Axis("x <1> & more"), Axis("y", log=True)
Place = tuple[float, float]


def series_of(*points: tuple[float, float], joined: bool = False, label: str = "") -> Series:
    return Series("a <b>", [Point(x, y, f"{x} & {y}", label) for x, y in points], joined)


def circles(svg: str) -> list[Place]:
    """Centres of the marks of the first series; the last one is that of the legend."""
    nodes = ElementTree.fromstring(svg).iter("circle")
    return [(float(node.attrib["cx"]), float(node.attrib["cy"])) for node in nodes][:-1]


def test_marks_lie_in_proportion() -> None:
    places = circles(plot([series_of((0, 1), (1, 10), (4, 100))], LINEAR, LOG, "title"))
    (x0, y0), (x1, y1), (x2, y2) = places
    assert (x1 - x0) / (x2 - x0) == pytest.approx(0.25, abs=1e-3)
    assert (y1 - y0) / (y2 - y0) == pytest.approx(0.5, abs=1e-3)
    assert y2 < y1 < y0  # up is more


def test_marks_lie_inside() -> None:
    for x, y in circles(plot([series_of((1, 3), (2, 1e6), (900, 5))], LOG, LOG, "title")):
        assert LEFT < x < WIDTH - RIGHT
        assert TOP < y < HEIGHT - BOTTOM


@pytest.mark.parametrize("points", [(), ((math.nan, 1.0),), ((1.0, 0.0),), ((1.0, math.inf),)])
def test_what_has_no_place_is_left_out(points: Sequence[Place]) -> None:
    svg = plot([series_of(*points)], LINEAR, LOG, "title")
    ElementTree.fromstring(svg)
    assert "nothing to show" in svg


def test_a_single_point() -> None:
    (place,) = circles(plot([series_of((3, 5))], LINEAR, LOG, "title"))
    assert place[0] == pytest.approx((LEFT + WIDTH - RIGHT) / 2, abs=1)


def test_series_look_different_and_are_named() -> None:
    svg = plot([Series(f"name{k}", [Point(k, 1, "t")]) for k in range(LOOKS)], LINEAR, LOG, "t")
    classes = [
        node.attrib["class"]
        for node in ElementTree.fromstring(svg).iter()
        if "mark" in node.attrib.get("class", "")
    ]
    assert len(set(classes)) == LOOKS
    assert all(f">name{k}<" in svg for k in range(LOOKS))


def test_every_look_has_a_colour_by_day_and_by_night() -> None:
    style = (files("spmm_torch.report") / "templates" / "style.css.j2").read_text(encoding="utf-8")
    for look in range(LOOKS):
        assert style.count(f"--s{look}: #") == 2
    assert f"range({LOOKS})" in style


def test_only_joined_series_have_a_line() -> None:
    points = ((1, 1), (2, 2))
    assert "<polyline" not in plot([series_of(*points)], LINEAR, LOG, "t")
    assert plot([series_of(*points, joined=True)], LINEAR, LOG, "t").count("<polyline") == 1


def test_labels_of_near_points_do_not_cover_each_other() -> None:
    svg = plot([series_of((1, 1), (1.01, 1.01), (9, 9), label="settings")], LINEAR, LINEAR, "t")
    texts = [node for node in ElementTree.fromstring(svg).iter("text") if node.text == "settings"]
    places = [(float(node.attrib["x"]), float(node.attrib["y"])) for node in texts]
    assert len(places) == 3
    for index, (x, y) in enumerate(places):
        for other_x, other_y in places[:index]:
            assert abs(x - other_x) > 40 or abs(y - other_y) >= 10


@pytest.mark.parametrize(
    ("low", "high"), [(0.0, 1.0), (-3.0, 7.0), (10.2, 10.9), (1234.0, 99999.0)]
)
@pytest.mark.parametrize("log", [False, True])
def test_ticks_are_round_and_inside(low: float, high: float, log: bool) -> None:
    if log:
        low, high = 10.0 ** (low / 3e4), 10.0 ** (high / 3e4 + 0.5)
    scale = Scale.over([low, high], 0.0, 100.0, log)
    ticks = scale.ticks()
    assert 2 <= len(ticks) <= 9
    assert ticks == sorted(set(ticks))
    assert all(-1e-6 <= scale(tick) <= 100.0 + 1e-6 for tick in ticks)


def test_numbers_are_short() -> None:
    shown = [tick_text(value) for value in (0.5, 4000.0, 1.5e6, -2.0, 2e9)]
    assert shown == ["0.5", "4k", "1.5M", "−2", "2G"]
