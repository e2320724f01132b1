"""Figures of slices: of the original itself, of worse models, and of anything with pictures."""

from __future__ import annotations

import sys
from dataclasses import astuple

import numpy as np
import pytest
import torch
from torch import Tensor

from spmm_torch.data import BTF
from spmm_torch.evaluate import slices
from spmm_torch.evaluate.slice_sample import SLICES
from spmm_torch.evaluate.slices import figures_of, model_pictures, slice_figures
from spmm_torch.geometry.relief import texel_centres
from tests.planted.btfs import COARSE_RINGS, measured, rough_btf, tabulated
from tests.planted.models import planted_model, planted_relief, with_relief, with_residual

BEST = 58.92  # dB: codes that differ by less than their rounding


@pytest.fixture(scope="module")
def btf() -> BTF:
    return rough_btf(12)


def blurred(btf: BTF):  # noqa: ANN201
    """Pictures without any difference of texels."""

    def picture(view: int, light: int) -> Tensor:
        original = btf.picture(view, light)
        return original.mean((0, 1), keepdim=True).expand_as(original)

    return picture


def test_the_original_is_as_good_as_can_be(btf: BTF) -> None:
    pytest.importorskip("flip_evaluator", reason="needs the extra eval")
    found = figures_of(btf, btf.picture, btf.picture)
    assert astuple(found.sharpness) == (1.0, 1.0, 1.0, 1.0)
    for value in astuple(found.display.psnr_db):
        assert value == pytest.approx(BEST, abs=0.01)
    for value in astuple(found.display.flip):
        assert value == pytest.approx(0.0, abs=1e-6)
    assert found.display.slices == SLICES


def test_a_blurred_model_is_worse(btf: BTF) -> None:
    pytest.importorskip("flip_evaluator", reason="needs the extra eval")
    found = figures_of(btf, btf.picture, blurred(btf))
    assert found.display.psnr_db.without_residual < found.display.psnr_db.with_residual
    assert found.display.flip.without_residual > found.display.flip.with_residual
    flat = figures_of(btf, blurred(btf))
    assert flat.sharpness.from_above == pytest.approx(0.0, abs=1e-12)
    assert flat.sharpness.in_place_all_views == pytest.approx(0.0, abs=1e-12)
    assert flat.display.psnr_db.without_residual is None


def test_noise_is_sharp_and_not_in_place(btf: BTF) -> None:
    generator = torch.Generator().manual_seed(0)

    def noisy(view: int, light: int) -> Tensor:
        original = btf.picture(view, light)
        return original + original.std() * torch.randn(original.shape, generator=generator)

    found = figures_of(btf, noisy).sharpness
    for share, in_place in (
        (found.from_above, found.in_place_from_above),
        (found.all_views, found.in_place_all_views),
    ):
        assert share > 1.5
        assert in_place == pytest.approx(1.0, abs=0.2)


def test_a_model_is_exact_for_its_own_table() -> None:
    model = with_residual(6)
    found = slice_figures(model, measured(model))
    assert found.sharpness.all_views == pytest.approx(1.0, abs=1e-4)
    assert found.display.psnr_db.with_residual > 50.0
    assert found.display.psnr_db.without_residual < found.display.psnr_db.with_residual


def test_pictures_are_those_of_the_model() -> None:
    model = with_residual(4)
    btf = measured(model)
    for residual in (True, False):
        found = model_pictures(model, btf, residual)(3, 5)
        expected = model.picture(btf.light[5], btf.view[3], residual=residual)
        torch.testing.assert_close(found, expected)


def test_a_scale_of_hdr_values_changes_nothing() -> None:
    """The exposure maps the peak to white."""
    model = planted_model(4, rings=COARSE_RINGS)
    values = tabulated(model).texels().unflatten(0, (4, 4))  # [H, W, D, C]
    count = len(model.view)
    pictures = values.unflatten(2, (count, count)).permute(2, 3, 0, 1, 4)
    found = []
    for scale in (10.0, 1000.0):
        btf = BTF.from_values(scale * pictures, model.view, model.light)
        assert btf.is_hdr
        soft = blurred(btf)
        found.append(figures_of(btf, soft).display.psnr_db.with_residual)
    assert found[0] == pytest.approx(found[1], abs=0.01)


def test_large_slices_show_their_middle_to_flip(monkeypatch: pytest.MonkeyPatch) -> None:
    seen: list[tuple[int, ...]] = []

    def flip_map(reference: np.ndarray, test: np.ndarray) -> np.ndarray:
        seen.append(reference.shape)
        return np.zeros(test.shape[:2])

    monkeypatch.setattr(slices, "flip_map", flip_map)
    monkeypatch.setattr(slices, "FLIP_SIZE", 5)
    btf = rough_btf(12)
    figures_of(btf, btf.picture)
    assert set(seen) == {(5, 5, 3)}
    assert len(seen) == SLICES // slices.FLIP_STEP


def test_flip_is_unknown_without_its_extra(monkeypatch: pytest.MonkeyPatch, btf: BTF) -> None:
    monkeypatch.setitem(sys.modules, "flip_evaluator", None)
    found = figures_of(btf, btf.picture)
    assert found.display.flip.with_residual is None
    assert found.display.psnr_db.with_residual is not None


def test_pictures_lie_as_the_measured_ones_do() -> None:
    model, btf = planted_model(6, rings=COARSE_RINGS, seed=1), rough_btf(6)
    drift = 0.1 * torch.rand(len(model.view), 2, generator=torch.Generator().manual_seed(2))
    model = with_relief(model, planted_relief(6, 6, 0.2, drift=drift))
    uv = texel_centres(6, 6, model.view)
    for view, light in ((0, 3), (7, 0)):
        wi, wo = model.light[light], model.view[view]
        expected = model(uv + drift[view], wi, wo).view(6, 6, 3).detach()
        torch.testing.assert_close(model_pictures(model, btf)(view, light).detach(), expected)
        assert not torch.allclose(model.picture(wi, wo), expected, rtol=1e-2)
