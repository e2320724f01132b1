"""Pages of texels that are materials: one row and four charts each, and figures that are true."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import torch

from spmm_torch.data import BTF
from spmm_torch.geometry.directions import ring_directions
from spmm_torch.model.spmm import SPMM
from spmm_torch.report import materials as section
from spmm_torch.report import write_html
from spmm_torch.report.plots import Point, Series
from spmm_torch.report.polar import FOOT, RADIUS, polar_plot
from tests.planted.btfs import measured, texel_btf
from tests.planted.models import uneven_model
from tests.report.test_page import Page

DIRECTIONS = ring_directions(((0.0, 1), (30.0, 6), (60.0, 12)))
NAMES = ("gold & <paint>", "felt", "black")


@pytest.fixture(scope="module")
def model() -> SPMM:
    """Three materials in a row; the last one has no lobe."""
    return uneven_model([2, 3, 0], 1, DIRECTIONS, DIRECTIONS, names=("lambertian", "ggx", "ward"))


@pytest.fixture(scope="module")
def btf(model: SPMM) -> BTF:
    """What the model is exact for."""
    return replace(measured(model), names=NAMES)


def test_the_page_shows_materials_and_no_pictures(
    model: SPMM, btf: BTF, report: dict[str, Any], tmp_path: Path
) -> None:
    write_html(tmp_path / "a.html", report, model, btf)
    text = (tmp_path / "a.html").read_text(encoding="utf-8")
    page = Page(text)
    shown = "".join(page.text)
    for name in NAMES:
        assert shown.count(name) >= 2
    assert "3 materials" in " ".join(shown.split())
    assert page.images() == {}
    charts = [each for each in page.elements if each[1].get("class") == "plot"]
    assert len(charts) == 4 * len(NAMES)
    assert "nan" not in text.lower().split("</style>")[-1]


def test_one_texel_is_a_material_and_a_texture_is_none(model: SPMM, btf: BTF) -> None:
    assert section.are_materials(btf)
    texture = replace(btf, names=None)
    assert not section.are_materials(texture)
    assert section.are_materials(texture.restricted(torch.tensor([1]), (1, 1)))


def test_figures_are_those_of_each_texel(model: SPMM, btf: BTF) -> None:
    rows = section.materials(model, btf)
    assert [row.name for row in rows] == list(NAMES)
    assert [row.lobes for row in rows] == [2, 3, 0]
    values = btf.texels().double()
    with torch.no_grad():
        pictures = [
            model.picture(*pair, residual=False)[0] for pair in zip(*btf.pairs(), strict=True)
        ]
    lobes = torch.stack(pictures, 1).double()
    for texel in (0, 1):
        energy = float(values[texel].square().sum())
        error = float((values[texel] - lobes[texel]).square().sum())
        found = rows[texel].without_residual
        assert found is not None
        assert found == pytest.approx(10.0 * math.log10(energy / error), abs=1e-3)


def test_albedo_of_a_white_surface_is_one() -> None:
    """By quadrature of its samples and by importance sampling of its lobe."""
    directions = ring_directions(((0.0, 1), (30.0, 12), (60.0, 24), (80.0, 24)))
    model = uneven_model([1], 1, directions, directions, 1, ("lambertian",))
    with torch.no_grad():
        model.normal.copy_(torch.tensor([[0.0, 0.0, 1.0]]))
        model.weight.fill_(1.0)
    btf = texel_btf(
        model.light[:, 2].repeat(len(directions))[None, :, None].repeat(1, 1, 3) / math.pi,
        directions,
    )
    polar, samples = section._measured_albedo(btf, 0)
    torch.testing.assert_close(polar, torch.tensor([0.0, 30.0, 60.0, 80.0]))
    torch.testing.assert_close(samples, torch.ones(4), atol=0.05, rtol=0.0)
    found = section._model_albedo(model, 0, polar, residual=False)
    torch.testing.assert_close(found, torch.ones(4), atol=0.02, rtol=0.0)


def test_only_the_worst_are_drawn(model: SPMM, btf: BTF, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(section, "MOST_DRAWN", 1)
    found = section.material_section(model, btf)
    assert len(found.rows) == 3
    worst = min(found.rows[:2], key=lambda row: row.with_residual or math.inf)
    assert [each.title for each in found.drawn] == [worst.name]
    assert "of the 1 of lowest SNR" in found.note


def test_a_polar_plot_puts_points_at_their_angle() -> None:
    points = [Point(0.0, 2.0, "up"), Point(math.pi / 2.0, 1.0, "right")]
    drawn = Page(polar_plot([Series("a", points)], "a", light=-0.5))
    marks = [each for name, each in drawn.elements if name == "circle"][:2]
    up, right = ((float(mark["cx"]), float(mark["cy"])) for mark in marks)
    assert up == pytest.approx((280.0, FOOT - RADIUS), abs=0.1)
    assert right == pytest.approx((280.0 + RADIUS / 2.0, FOOT), abs=0.1)


@pytest.mark.parametrize("kept", [1, 40, 300])
def test_pairs_without_samples_are_left_out(
    model: SPMM, btf: BTF, report: dict[str, Any], tmp_path: Path, kept: int
) -> None:
    missing = torch.ones(btf.pair_count, dtype=torch.bool)
    missing[torch.randperm(btf.pair_count, generator=torch.Generator().manual_seed(0))[:kept]] = (
        False
    )
    write_html(tmp_path / "a.html", report, model, replace(btf, missing=missing.view(19, 19)))
    text = (tmp_path / "a.html").read_text(encoding="utf-8")
    assert text.count('class="plot"') == 4 * len(NAMES)
    assert "nan" not in text.lower().split("</style>")[-1]
