"""The page of an edited run: its edits, and the model before and after them."""

from __future__ import annotations

from pathlib import Path

import pytest

from spmm_torch.edit import intensity
from spmm_torch.model.spmm import SPMM
from spmm_torch.report.edited import write_edited_html
from spmm_torch.report.pairs import choose_pairs
from tests.report.test_page import Page

SCRIPT = "- intensity:\n    factor: 0.5  # <script>\n"


@pytest.fixture
def page(tmp_path: Path, model: SPMM) -> Page:
    """The page of a model whose lobes got darker."""
    write_edited_html(tmp_path / "report.html", model, intensity(model, 0.5), SCRIPT)
    return Page((tmp_path / "report.html").read_text(encoding="utf-8"))


def test_texts_are_escaped(page: Page, model: SPMM) -> None:
    assert not any(name in {"b", "script"} for name, _ in page.elements)
    assert page.text.count(f"{model.name} – edited") == 2  # title and heading
    assert SCRIPT in page.text


def test_pictures_show_both_models_with_one_exposure(page: Page, model: SPMM) -> None:
    images = page.images()
    pairs = choose_pairs(model.light, model.view)
    assert len(images) == 2 * len(pairs) + 2
    for pair in pairs:
        before, after = images[f"{pair.title}: before"], images[f"{pair.title}: after"]
        assert (after <= before).all()
        assert after.mean() < before.mean()


def test_sizes_of_both_models(page: Page, model: SPMM) -> None:
    first = page.text.index("Lobes in the dictionary")
    shown = [text for text in page.text[first:] if text.strip()]
    assert shown[1:3] == [f"{len(model.dictionary)}"] * 2
    assert shown[shown.index("Clusters") + 1] == f"{model.cluster_count}"
