"""report.html: valid, self-contained, and it shows what it says."""

from __future__ import annotations

import base64
import copy
import io
import math
import re
from collections.abc import Callable, Sequence
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from PIL import Image

from spmm_torch.brdf import MODEL_NAMES
from spmm_torch.data import BTF
from spmm_torch.model.spmm import SPMM
from spmm_torch.report import write_html
from spmm_torch.report.maps import model_maps
from spmm_torch.report.pairs import choose_pairs
from spmm_torch.report.slices import slice_snr, take_slices
from spmm_torch.report.views import Gallery

Write = Callable[..., str]
# Elements without an end tag.
VOID = frozenset({"img", "meta"})


class Page(HTMLParser):
    """Elements, attributes and text of a page; fails where elements do not nest."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.elements: list[tuple[str, dict[str, str]]] = []
        self.text: list[str] = []
        self.feed(text)
        self.close()
        assert self.open == []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.elements.append((tag, {key: value or "" for key, value in attrs}))
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.text.append(data)

    def images(self) -> dict[str, np.ndarray]:
        """Codes of every picture by its alternative text."""
        found = {}
        for name, attributes in self.elements:
            if name == "img":
                head, _, data = attributes["src"].partition(",")
                assert head == "data:image/png;base64"
                picture = Image.open(io.BytesIO(base64.b64decode(data, validate=True)))
                assert picture.format == "PNG"
                found[attributes["alt"]] = np.asarray(picture)
        return found


@pytest.fixture
def write(tmp_path: Path, report: dict[str, Any], model: SPMM, btf: BTF) -> Write:
    """Writes a page and reads it; any part may be given."""

    def run(
        report: dict[str, Any] = report,
        model: SPMM = model,
        btf: BTF = btf,
        sections: Sequence[Gallery] = (),
    ) -> str:
        path = tmp_path / "report.html"
        write_html(path, report, model, btf, sections)
        return path.read_text(encoding="utf-8")

    return run


def test_the_page_nests_and_refers_to_nothing_outside(write: Write) -> None:
    text = write()
    page = Page(text)
    assert text.startswith("<!DOCTYPE html>\n<html lang=")
    assert not re.search(r"https?:|//[a-z]|@import|url\(", re.sub(r"base64,[^\"]*", "", text))
    names = {name for name, _ in page.elements}
    assert not names & {"script", "link", "iframe", "object"}
    assert all("data:" in given["src"] for _, given in page.elements if "src" in given)
    assert not any("href" in given for _, given in page.elements)


def test_sections_stand_before_every_figure(write: Write) -> None:
    text = write(sections=[Gallery("Original and model", "a note", ())])
    assert text.index("Original and model") < text.index('class="card"')
    assert text.index('class="card"') < text.index("Texture slices")


def test_names_are_escaped(write: Write, btf: BTF, report: dict[str, Any]) -> None:
    report["input"] = "<script>alert(1)</script>.zip"
    page = Page(write())
    assert not any(name in {"b", "script"} for name, _ in page.elements)
    assert page.text.count(btf.name) == 2  # heading and row of the table
    assert report["input"] in page.text


def test_every_picture_has_the_size_of_the_texture(write: Write, model: SPMM, btf: BTF) -> None:
    images = Page(write()).images()
    pairs = choose_pairs(btf.light, btf.view)
    assert len(images) == 4 * len(pairs) + 2
    assert {codes.shape for codes in images.values()} == {(model.height, model.width, 3)}


def test_pictures_show_original_and_model(write: Write, btf: BTF) -> None:
    images = Page(write()).images()
    for pair in choose_pairs(btf.light, btf.view):
        original = images[f"{pair.title}: Original"].astype(int)
        whole = images[f"{pair.title}: Lobes + residual"].astype(int)
        assert np.abs(original - whole).max() <= 1
        order = btf.picture(pair.view, pair.light).numpy()[..., 1]
        brightest = np.unravel_index(order.argmax(), order.shape)
        assert original[..., 1][brightest] == original[..., 1].max()
        difference = next(
            codes for name, codes in images.items() if name.startswith(f"{pair.title}: Diff")
        )
        assert difference.max() < 40


def test_slices_take_the_pair_that_their_title_says(model: SPMM, btf: BTF) -> None:
    pairs = choose_pairs(btf.light, btf.view)
    for part, pair in zip(take_slices(model, btf, pairs), pairs, strict=True):
        assert part.title == pair.title
        assert torch.equal(part.original, btf.picture(pair.view, pair.light))
        assert slice_snr(part.original, part.model) > 80.0
        assert slice_snr(part.original, part.lobes) < 40.0


def test_maps_show_labels_and_lobe_counts(write: Write, model: SPMM) -> None:
    images = Page(write()).images()
    counts = model.lobe_count_per_texel()
    for name, index in (
        ("Cluster map", model.labels),
        ("Map of the number of lobes of each texel", counts),
    ):
        codes = torch.from_numpy(images[name].copy()).view(-1, 3).long()
        same_colour = (codes[:, None] == codes[None]).all(-1)
        assert torch.equal(same_colour, index[:, None] == index[None])


def test_figures_of_the_report_are_shown(write: Write, report: dict[str, Any]) -> None:
    report["snr_db"] = {"without_residual": 6.43, "with_residual": 7.5, "cluster_mean": 6.75}
    shown = " ".join(Page(write()).text)
    for expected in ("42 %", "31 % in place", "24.50 dB", "lobes 21.25 dB", "0.112"):
        assert expected in shown
    for expected in ("7.50 dB", "6.43 dB", "6.75 dB", "+0.75 dB", "36.1 s", "Compression time"):
        assert expected in shown


def test_unknown_and_infinite_figures(write: Write, report: dict[str, Any]) -> None:
    report["snr_db"] = {"without_residual": None, "with_residual": math.inf, "cluster_mean": 3.0}
    report["psnr_db"] = {"without_residual": math.nan, "with_residual": math.inf}
    report["peak_memory_bytes"] = None
    report["seconds"]["total"] = None
    shown = " ".join(Page(write()).text)
    assert "exact" in shown
    assert not re.search(r"\b(inf|nan|None)\b", shown)


def test_one_texel_is_a_material_without_pictures(
    write: Write, one_texel: tuple[SPMM, BTF]
) -> None:
    model, btf = one_texel
    page = Page(write(model=model, btf=btf))
    assert not page.images()
    assert "Materials" in page.text
    assert sum(each.get("class") == "plot" for _, each in page.elements) == 3  # one light


def test_a_bad_report_writes_no_page(write: Write, report: dict[str, Any], tmp_path: Path) -> None:
    del report["seed"]
    with pytest.raises(ValueError, match="seed"):
        write()
    assert not list(tmp_path.iterdir())


def test_a_black_slice_has_no_snr() -> None:
    black = torch.zeros(2, 2, 3)
    assert slice_snr(black, black + 1.0) is None
    assert slice_snr(black + 1.0, black + 1.0) == math.inf


def test_lobes_are_counted_under_the_titles_of_their_brdfs(model: SPMM) -> None:
    """Not under titles made of their names: that of `ggx` is GGX."""
    model = copy.deepcopy(model)
    model.lobe_model.fill_(MODEL_NAMES.index("ggx"))
    assert ">GGX<" in model_maps(model).models.drawing
