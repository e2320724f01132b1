"""How masks split lobes, whatever the edit."""

from __future__ import annotations

import torch

from spmm_torch import SPMM
from spmm_torch.edit import (
    EVERYTHING,
    Rectangle,
    Stripes,
    lobe_group,
    replace_model,
    scale_width,
    select_texels,
    spread_normals,
)
from tests.edit.looks import check_valid, look


def test_hard_mask_splits_only_lobes_that_both_sides_use(model: SPMM) -> None:
    mask = Rectangle(0, 0, 4, 8).mask(model)  # the whole first cluster, whose lobes are its own
    edited = spread_normals(model, 1.5, select_texels(model, mask))
    assert len(edited.lobe_model) == len(model.lobe_model)
    assert len(edited.index) == len(model.index)
    cut = spread_normals(model, 1.5, select_texels(model, Rectangle(0, 0, 2, 8).mask(model)))
    assert len(model.lobe_model) < len(cut.lobe_model) <= len(model.lobe_model) + 6
    for each in (edited, cut):
        check_valid(each)


def test_mask_touches_only_its_texels(model: SPMM) -> None:
    mask = Rectangle(1, 1, 3, 4).mask(model)
    where = select_texels(model, mask)
    outside = mask.flatten() == 0.0
    for edit in (
        lambda w: spread_normals(model, 2.0, w),
        lambda w: scale_width(model, 0.5, w, keep_energy=True),
        lambda w: replace_model(model, "ward", w),
    ):
        edited, whole = edit(where), edit(EVERYTHING)
        torch.testing.assert_close(look(edited)[:, outside], look(model)[:, outside])
        torch.testing.assert_close(look(edited)[:, ~outside], look(whole)[:, ~outside])
        check_valid(edited)


def test_a_group_under_a_mask_is_what_both_select(model: SPMM) -> None:
    """Nothing outside of the mask; inside, what the group alone does."""
    mask = Rectangle(1, 1, 3, 4).mask(model)
    group = lobe_group(model, "specular")
    edited = spread_normals(model, 2.0, select_texels(model, mask) & group)
    inside = mask.flatten() > 0.0
    torch.testing.assert_close(look(edited)[:, ~inside], look(model)[:, ~inside])
    alone = spread_normals(model, 2.0, group)
    torch.testing.assert_close(look(edited)[:, inside], look(alone)[:, inside])
    assert not torch.allclose(look(alone), look(spread_normals(model, 2.0)))
    check_valid(edited)


def test_soft_mask_mixes_edited_and_unedited(model: SPMM) -> None:
    mask = Stripes(2, 0.5, 0.6).mask(model)
    edited = spread_normals(model, 2.0, select_texels(model, mask))
    share = mask.flatten()[None, :, None]
    expected = (1.0 - share) * look(model) + share * look(spread_normals(model, 2.0))
    torch.testing.assert_close(look(edited), expected, rtol=1e-4, atol=1e-5)
    check_valid(edited)


def test_a_mask_of_nothing_changes_nothing(model: SPMM) -> None:
    where = select_texels(model, torch.zeros(8, 8))
    assert spread_normals(model, 2.0, where) is model
