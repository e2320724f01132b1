"""The legend on the page of a scene."""

from __future__ import annotations

from spmm_torch.viz.html import TITLE, with_legend
from spmm_torch.viz.scene import LegendRow, Scene, View
from tests.report.test_page import Page

PAGE = f'<html><head><meta charset="utf-8">{TITLE}</head><body><p>rest</p></body></html>'


def test_legend_and_title_are_escaped() -> None:
    rows = (LegendRow("ward <i>", (1.0, 0.0, 0.0)), LegendRow("light & view"))
    axis = (0.0, 0.0, 1.0)
    scene = Scene("Texel of <script>", (), rows, View(axis, axis, axis, 1.0))
    text = with_legend(PAGE, scene)
    page = Page(text)
    assert "script" not in {name for name, _ in page.elements}
    assert page.text.count("Texel of <script>") == 2
    assert {"ward <i>", "light & view", "rest"} <= set(page.text)
    squares = [given["style"] for name, given in page.elements if name == "i"]
    assert squares == ["background: #ff0000"]
