"""The relief on the page: its map, and the oblique view with and without it."""

from __future__ import annotations

import torch

from spmm_torch import SPMM
from spmm_torch.geometry.directions import MIRROR
from spmm_torch.model.relief import Relief
from spmm_torch.report.maps import model_maps
from spmm_torch.report.relief import height_map, relief_gallery
from tests.planted.btfs import measured
from tests.planted.models import planted_relief, with_relief


def test_flat_models_show_no_relief(model: SPMM) -> None:
    assert model_maps(model).heights is None
    assert relief_gallery(model, measured(model)) is None


def test_the_oblique_view_is_shown_with_and_without_it(model: SPMM) -> None:
    rough = with_relief(model, planted_relief(5, 7, 0.2, MIRROR))
    found = relief_gallery(rough, measured(rough))
    assert found is not None
    (row,) = found.rows
    original, with_it, without = row.pictures
    assert with_it.uri == original.uri  # the BTF is that of the model
    assert without.uri != original.uri
    assert "SNR" in with_it.caption
    assert "SNR" in without.caption
    assert rough.relief is not None
    assert rough.relief.rule == MIRROR  # not changed


def test_heights_are_told(model: SPMM) -> None:
    rough = with_relief(model, Relief(torch.arange(35, dtype=torch.uint8), 0.001, -0.01))
    assert rough.relief is not None
    caption = height_map(rough, rough.relief).caption
    assert "-1 % (dark) to 2.4 % (bright)" in caption
    assert "A plane, 3 %" in height_map(model, Relief(None, 0.0, 0.03)).caption
    assert model_maps(rough).heights is not None
