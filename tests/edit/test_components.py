"""Edits of a residual of rank R: exact under hard masks, and nothing else changes."""

from __future__ import annotations

import pytest
import torch
from torch import Tensor

from spmm_torch import SPMM
from spmm_torch.edit import (
    EVERYTHING,
    Rectangle,
    Stripes,
    blend,
    copy_look,
    hue_saturation,
    intensity,
    lobe_group,
    residual_strength,
    select_texels,
)
from spmm_torch.edit.components import HALF_LIMIT
from spmm_torch.edit.residual import mapped_residual
from tests.edit.looks import check_valid, look
from tests.planted.models import FEW_RINGS, planted_model, with_components

INSIDE = Rectangle(1, 2, 4, 3)


def epsilon(model: SPMM) -> Tensor:
    return look(model) - look(model, residual=False)


def test_unmasked_edits_share_the_functions(rank_model: SPMM) -> None:
    edited = intensity(rank_model, 3.0)
    torch.testing.assert_close(look(edited), 3.0 * look(rank_model))
    assert edited.components.code.data_ptr() == rank_model.components.code.data_ptr()
    bare = residual_strength(rank_model, 0.0)
    torch.testing.assert_close(look(bare), look(rank_model, residual=False))
    for each in (edited, bare):
        check_valid(each)


@pytest.mark.parametrize("factor", [0.0, 0.5, 3.7, 100.0])
def test_a_hard_mask_scales_its_texels_and_no_other(rank_model: SPMM, factor: float) -> None:
    mask = INSIDE.mask(rank_model)
    edited = residual_strength(rank_model, factor, select_texels(rank_model, mask))
    inside = mask.flatten() > 0.0
    assert torch.equal(look(edited)[:, ~inside], look(rank_model)[:, ~inside])
    expected = factor * epsilon(rank_model)[:, inside]
    torch.testing.assert_close(epsilon(edited)[:, inside], expected, rtol=2e-3, atol=1e-4 * factor)
    assert edited.components.rank == rank_model.components.rank
    assert torch.equal(edited.labels, rank_model.labels)
    check_valid(edited)


def test_residuals_that_a_mask_removes_stay_bytes(rank_model: SPMM) -> None:
    mask = INSIDE.mask(rank_model)
    edited = residual_strength(rank_model, 0.0, select_texels(rank_model, mask))
    assert edited.components.coefficient.dtype == torch.int8
    assert not edited.components.coefficient[mask.flatten() > 0.0].any()


def test_a_soft_mask_is_followed_texel_by_texel(rank_model: SPMM) -> None:
    mask = Stripes(1, 0.5, 0.5).mask(rank_model)
    edited = intensity(rank_model, 3.0, select_texels(rank_model, mask))
    gain = 1.0 + 2.0 * mask.flatten()[None, :, None]
    torch.testing.assert_close(look(edited), gain * look(rank_model), rtol=1e-3, atol=1e-4)
    check_valid(edited)


def test_many_edits_never_reach_infinity(rank_model: SPMM) -> None:
    where = select_texels(rank_model, INSIDE.mask(rank_model))
    edited = rank_model
    for _ in range(4):
        edited = residual_strength(edited, 50.0, where)
    outside = where.texels == 0.0
    assert torch.equal(epsilon(edited)[:, outside], epsilon(rank_model)[:, outside])
    assert float(edited.components.coefficient.abs().max()) <= HALF_LIMIT
    torch.testing.assert_close(
        epsilon(edited)[:, ~outside],
        50.0**4 * epsilon(rank_model)[:, ~outside],
        rtol=5e-3,
        atol=2e-4 * 50.0**4,
    )


def test_colours_under_a_mask_are_those_without_one(rank_model: SPMM) -> None:
    """Inside as if everything were edited, outside as before, both to the bit."""
    mask, matrix = INSIDE.mask(rank_model), torch.tensor([[0, 1.0, 0], [0, 0, 1.0], [0.5, 0, 0.5]])
    where = select_texels(rank_model, mask)
    edited, whole = (mapped_residual(rank_model, matrix, each) for each in (where, EVERYTHING))
    inside = mask.flatten() > 0.0
    assert edited.components.rank == 2 * rank_model.components.rank
    assert edited.components.coefficient.dtype == torch.int8
    texel = torch.arange(rank_model.texel_count)
    wi, wo = rank_model.light[5], rank_model.view[9]
    found, mapped, before = (
        each(texel, wi, wo) for each in (edited.components, whole.components, rank_model.components)
    )
    torch.testing.assert_close(found[inside], mapped[inside], rtol=1e-6, atol=1e-8)
    torch.testing.assert_close(found[~inside], before[~inside], rtol=1e-6, atol=1e-8)
    torch.testing.assert_close(mapped, before @ matrix.T, rtol=0.0, atol=2e-3)


def test_colours_under_a_soft_mask(rank_model: SPMM) -> None:
    mask = Stripes(1, 0.5, 0.5).mask(rank_model)
    permuted = hue_saturation(rank_model, 2.0 * torch.pi / 3.0, fit="unit")
    edited = hue_saturation(
        rank_model, 2.0 * torch.pi / 3.0, where=select_texels(rank_model, mask), fit="unit"
    )
    expected = torch.lerp(epsilon(rank_model), epsilon(permuted), mask.flatten()[None, :, None])
    torch.testing.assert_close(epsilon(edited), expected, rtol=1e-3, atol=1e-4)
    check_valid(edited)


def test_components_that_no_texel_has_are_left_out(rank_model: SPMM) -> None:
    where = select_texels(rank_model, torch.ones(8, 8))
    assert hue_saturation(rank_model, 1.0, where=where).components.rank == 3


def test_a_group_of_lobes_leaves_components(rank_model: SPMM) -> None:
    edited = intensity(rank_model, 3.0, lobe_group(rank_model, "specular"))
    assert edited.components is rank_model.components


def test_copies_move_coefficients(rank_model: SPMM) -> None:
    target = Rectangle(4, 2, 3, 3).mask(rank_model)
    edited = copy_look(rank_model, Rectangle(0, 1, 2, 2), select_texels(rank_model, target))
    picture, before = (look(each).unflatten(1, (8, 8)) for each in (edited, rank_model))
    torch.testing.assert_close(picture[:, 2:4, 4:6], before[:, 1:3, 0:2])
    assert edited.components.rank == rank_model.components.rank
    assert edited.components.coefficient.dtype == torch.int8
    check_valid(edited)


def others() -> list[SPMM]:
    """Models with other components, with clusters alone, and with both."""
    plain = planted_model(clusters=4, lobes_per_cluster=5, rings=FEW_RINGS, residual=0.05, seed=8)
    return [
        with_components(plain, 2, dtype=torch.float16),
        plain,
        with_components(plain, 2, beside=True),
    ]


@pytest.mark.parametrize("other", others(), ids=["components", "clusters", "both"])
def test_blends_of_models_with_other_residuals(rank_model: SPMM, other: SPMM) -> None:
    """Whole texels of either; components also in between."""
    mask = INSIDE.mask(rank_model)
    inside = mask.flatten() > 0.0
    for one, two in ((rank_model, other), (other, rank_model)):
        edited = blend(one, two, 1.0, select_texels(one, mask))
        torch.testing.assert_close(
            look(edited)[:, inside], look(two)[:, inside], rtol=1e-4, atol=1e-4
        )
        torch.testing.assert_close(
            look(edited)[:, ~inside], look(one)[:, ~inside], rtol=1e-4, atol=1e-4
        )
        check_valid(edited)
    if not len(other.residual.code):
        half = epsilon(blend(rank_model, other, 0.25))
        expected = 0.75 * epsilon(rank_model) + 0.25 * epsilon(other)
        torch.testing.assert_close(half, expected, rtol=1e-3, atol=1e-4)


def test_a_blend_with_an_edited_self_keeps_the_rank(rank_model: SPMM) -> None:
    mixed = blend(rank_model, intensity(rank_model, 3.0), 0.5)
    assert mixed.components.rank == rank_model.components.rank
    torch.testing.assert_close(look(mixed), 2.0 * look(rank_model), rtol=1e-3, atol=1e-4)
