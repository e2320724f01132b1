"""What is drawn on the texture is what is selected."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from spmm_torch import SPMM
from spmm_torch.edit import Rectangle
from spmm_torch.edit.masks.cluster import ClusterMask
from spmm_torch.viz.editor.brush import painted, picture_mask, rectangle_between, texel_under
from spmm_torch.viz.editor.drawing import Drawing
from spmm_torch.viz.editor.session import Session


@pytest.mark.parametrize("corners", [((0.1, 0.2), (0.6, 0.9)), ((0.6, 0.9), (0.1, 0.2))])
def test_rectangles_hold_the_texels_of_both_corners(corners) -> None:  # noqa: ANN001
    assert rectangle_between(*corners, height=10, width=20) == Rectangle(2, 2, 11, 8)


def test_rectangles_stay_inside() -> None:
    assert rectangle_between((-0.3, 0.5), (1.4, 0.5), 8, 8) == Rectangle(0, 4, 8, 1)


def test_texels_count_from_the_upper_left() -> None:
    assert texel_under((0.99, 0.01), 4, 6) == 5
    assert texel_under((0.0, 1.0), 4, 6) == 18


def test_a_disk_is_painted_and_erased() -> None:
    empty = np.zeros((20, 20), dtype=np.float32)
    disk = painted(empty, (0.5, 0.5), 0.2, erase=False)
    assert disk.sum() == pytest.approx(np.pi * 16.0, rel=0.1)
    assert disk[10, 10] == 1.0
    assert disk[0, 0] == 0.0
    assert np.array_equal(disk, disk.T)
    assert painted(disk, (0.5, 0.5), 0.4, erase=True).sum() == 0.0


def test_painted_masks_are_pictures_named_by_content(model: SPMM, tmp_path: Path) -> None:
    shares = np.zeros((8, 8), dtype=np.float32)
    shares[2, 3] = 1.0
    mask = picture_mask(shares, tmp_path)
    assert mask == picture_mask(shares.copy(), tmp_path)
    assert mask != picture_mask(1.0 - shares, tmp_path)
    selected = mask.select(model).texels
    assert selected is not None
    assert selected.nonzero().flatten().tolist() == [19]


@pytest.fixture
def drawing(run: Path, tmp_path: Path) -> Drawing:
    return Drawing(Session.open(run), tmp_path)


def test_a_rectangle_is_shown_while_it_is_dragged_and_selected_at_the_end(
    drawing: Drawing,
) -> None:
    plain = drawing.picture()
    drawing.choose("rectangle")
    drawing.drag((0.9, 0.9))  # nothing is pressed yet
    assert np.array_equal(drawing.picture(), plain)
    drawing.press((0.1, 0.1))
    drawing.drag((0.4, 0.2))
    assert not np.array_equal(drawing.picture(), plain)
    assert drawing.session.mask is None
    drawing.drop((0.6, 0.3))
    assert drawing.session.mask == Rectangle(0, 0, 5, 3)
    drawing.choose("all")
    assert drawing.session.mask is None
    assert np.array_equal(drawing.picture(), plain)


def test_painting_adds_to_the_selection_and_erasing_takes_away(drawing: Drawing) -> None:
    drawing.brush = 0.07
    selected = []
    for tool, at in (("paint", (0.2, 0.2)), ("paint", (0.8, 0.8)), ("erase", (0.2, 0.2))):
        drawing.choose(tool)
        drawing.press(at)
        drawing.drop(at)
        mask = drawing.session.mask
        assert mask is not None
        texels = mask.select(drawing.session.original).texels
        assert texels is not None
        selected.append({int(texel) for texel in (texels > 0.5).nonzero()})
    first, both, second = selected
    assert 9 in first
    assert first < both
    assert second == both - first


def test_a_click_selects_the_cluster_under_it(drawing: Drawing) -> None:
    drawing.choose("cluster")
    drawing.press((0.9, 0.5))
    drawing.drop((0.9, 0.5))
    assert drawing.session.mask == ClusterMask((1,))


@pytest.mark.parametrize("tool", ["rectangle", "paint", "cluster"])
def test_a_picture_without_a_size_has_no_places(drawing: Drawing, tool: str) -> None:
    """A page divides by the width of the picture, which is 0 before it is shown."""
    drawing.choose(tool)
    drawing.press((math.nan, math.inf))
    drawing.drop((math.nan, math.nan))
    assert drawing.session.mask is None
