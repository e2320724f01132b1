"""Regions copied to others."""

from __future__ import annotations

import pytest
import torch

from spmm_torch import SPMM, ConfigError
from spmm_torch.edit import Rectangle, copy_look, lobe_selection, rearranged, select_texels
from tests.edit.looks import check_valid, look


def test_copied_region(model: SPMM) -> None:
    target = Rectangle(4, 2, 3, 3).mask(model)
    edited = copy_look(model, Rectangle(0, 1, 2, 2), select_texels(model, target))
    picture, before = (look(each).unflatten(1, (8, 8)) for each in (edited, model))
    for row in range(8):
        for column in range(8):
            source = (row, column)
            if target[row, column] > 0.0:
                source = (1 + (row - 2) % 2, (column - 4) % 2)
            torch.testing.assert_close(picture[:, row, column], before[:, source[0], source[1]])
    assert len(edited.lobe_model) <= len(model.lobe_model)
    check_valid(edited)


def test_copy_everywhere_tiles_the_texture(model: SPMM) -> None:
    tiled = look(copy_look(model, Rectangle(2, 3, 4, 2))).unflatten(1, (8, 8))
    torch.testing.assert_close(tiled[:, :, :4], tiled[:, :, 4:])
    torch.testing.assert_close(tiled[:, :2], tiled[:, 2:4])


def test_rearranged(model: SPMM) -> None:
    origin = torch.randint(64, (64,), generator=torch.Generator().manual_seed(2))
    torch.testing.assert_close(look(rearranged(model, origin)), look(model)[:, origin])


def test_bad_input(model: SPMM) -> None:
    with pytest.raises(ConfigError, match="copying a look takes whole texels"):
        copy_look(model, Rectangle(0, 0, 1, 1), lobe_selection(model, specular=True))
    with pytest.raises(ConfigError, match="reaches out of the texture"):
        copy_look(model, Rectangle(7, 7, 2, 1))
