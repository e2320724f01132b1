"""Templates: escaped, complete, strict about what they show, and part of the package."""

from __future__ import annotations

from configparser import ConfigParser
from fnmatch import fnmatch
from importlib.resources import files

import pytest
from jinja2 import UndefinedError

from spmm_torch.report.html import render_template
from spmm_torch.report.views import Picture
from tests.locations import ROOT
from tests.report.test_page import Page

PICTURE = Picture("data:,", '"><script>', "<script>alert(1)</script>")


def test_what_is_shown_is_escaped() -> None:
    page = Page(render_template("figures.html.j2", {"name": "<b>&", "pictures": [PICTURE]}))
    assert not any(name in {"b", "script"} for name, _ in page.elements)
    assert page.text.count("<b>&") == 1
    assert {PICTURE.alternative, PICTURE.caption} <= set(page.text)
    assert {"src": "data:,", "alt": PICTURE.alternative} in [given for _, given in page.elements]


def test_a_missing_value_is_an_error() -> None:
    with pytest.raises(UndefinedError, match="pictures"):
        render_template("figures.html.j2", {"name": "wool"})


def test_every_template_is_packaged() -> None:
    setup = ConfigParser()
    setup.read(ROOT / "setup.cfg")
    patterns = setup["options.package_data"]["spmm_torch.report"].split(", ")
    names = [path.name for path in (files("spmm_torch.report") / "templates").iterdir()]
    assert "base.html.j2" in names
    for name in names:
        assert any(fnmatch(f"templates/{name}", pattern) for pattern in patterns), name
