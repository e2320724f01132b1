"""`make docs`: a page for every module, and no warning."""

from __future__ import annotations

import runpy
from pathlib import Path
from typing import Any

import pytest

from tests.locations import DOCS
from tests.test_import_floors import sources

pytest.importorskip("pdoc", reason="needs the extra docs")


@pytest.fixture(scope="module")
def builder() -> dict[str, Any]:
    """The names of the script."""
    return runpy.run_path(str(DOCS / "reference" / "build.py"))


def test_every_module_is_documented(builder: dict[str, Any]) -> None:
    modules = {name for name in sources() if not name.endswith(".__main__")}
    assert set(builder["module_names"]()) == modules


@pytest.mark.slow
def test_the_pages_are_made_without_a_warning(builder: dict[str, Any], tmp_path: Path) -> None:
    builder["build"](tmp_path)
    page = (tmp_path / "spmm_torch" / "model" / "spmm.html").read_text(encoding="utf-8")
    assert "Cosine-weighted reflectance" in page
    assert "spmm_torch/model/spmm.html" in (tmp_path / "index.html").read_text(encoding="utf-8")
