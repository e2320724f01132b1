"""SVG elements escape all but markup."""

from __future__ import annotations

from markupsafe import Markup

from spmm_torch.report.svg import element


def test_content_and_attributes_are_escaped() -> None:
    assert element("text", "a < b", Markup("<tspan/>"), id='"&') == (
        '<text id="&#34;&amp;">a &lt; b<tspan/></text>'
    )
    assert element("g", str(element("text", "x")) + "<i>") == (
        "<g>&lt;text&gt;x&lt;/text&gt;&lt;i&gt;</g>"
    )


def test_names_of_attributes() -> None:
    assert element("text", x=1.5, class_="small", text_anchor="end") == (
        '<text x="1.5" class="small" text-anchor="end"></text>'
    )
