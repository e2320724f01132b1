"""The edit of hue and saturation."""

from __future__ import annotations

import math

import pytest
import torch

from spmm_torch import SPMM, ConfigError
from spmm_torch.edit import (
    Rectangle,
    change_colours,
    hue_saturation,
    lobe_group,
    residual_strength,
    select_texels,
)
from spmm_torch.edit.edits.hue_saturation import non_negative
from spmm_torch.edit.entries import entry_texels
from spmm_torch.edit.look import sample_look
from spmm_torch.edit.parts import with_parts
from spmm_torch.model.lookup import SparseWeights
from tests.edit.looks import check_valid, look


@pytest.mark.parametrize("fit", ["material", "unit"])
def test_desaturation_makes_grey(model: SPMM, fit: str) -> None:
    grey = hue_saturation(model, saturation=0.0, fit=fit)
    shown = look(grey, residual=False)
    torch.testing.assert_close(shown, shown.mean(2, keepdim=True).expand_as(shown))
    check_valid(grey)


@pytest.mark.parametrize("fit", ["material", "unit"])
@pytest.mark.parametrize("hue", [2.0 * math.pi / 3.0, 0.5])
def test_hue_forth_and_back_returns(model: SPMM, hue: float, fit: str) -> None:
    """A third of a turn permutes the channels, exactly; others return on average."""
    back = hue_saturation(hue_saturation(model, hue, fit=fit), -hue, fit=fit)
    before, after = look(model), look(back)
    error = float((after - before).norm() / before.norm())
    assert error < (0.01 if hue > 1.0 else 0.2)
    check_valid(back)


def test_material_fit_is_the_exact_change_of_one_hue(model: SPMM) -> None:
    """Colours between red and orange turn linearly as long as no channel passes another."""
    weight = torch.tensor([1.0, 0.4, 0.1]) * torch.tensor([1.0, 1.1, 1.2]) ** torch.rand(
        len(model.weight), 1, generator=torch.Generator().manual_seed(2)
    )
    weights = SparseWeights(model.offset, model.index, weight)
    coloured = with_parts(residual_strength(model, 0.0), weights=weights)
    expected = change_colours(look(coloured), 0.3, 1.0)
    found = look(hue_saturation(coloured, 0.3))
    paper = look(hue_saturation(coloured, 0.3, fit="unit"))
    error, paper_error = (float((each - expected).norm()) for each in (found, paper))
    assert error < 0.05 * float(expected.norm())
    assert error < 0.5 * paper_error


def test_specular_hue_leaves_the_rest(model: SPMM) -> None:
    where = lobe_group(model, "specular")
    edited = hue_saturation(model, 2.0, 1.5, where)
    assert where.lobes is not None
    chosen = where.lobes[model.index]
    assert torch.equal(edited.weight[~chosen], model.weight[~chosen])
    assert not torch.equal(edited.weight[chosen], model.weight[chosen])
    assert edited.residual.code.data_ptr() == model.residual.code.data_ptr()
    check_valid(edited)


def test_mask_touches_only_its_texels(model: SPMM) -> None:
    mask = Rectangle(1, 2, 4, 3).mask(model)
    edited = hue_saturation(model, 2.0, 1.8, select_texels(model, mask))
    outside = mask.flatten() == 0.0
    texel = entry_texels(model)
    assert torch.equal(edited.weight[outside[texel]], model.weight[outside[texel]])
    torch.testing.assert_close(look(edited)[:, outside], look(model)[:, outside])
    assert not torch.allclose(look(edited)[:, ~outside], look(model)[:, ~outside])
    check_valid(edited)


def test_negative_weights_are_taken_from_the_others(model: SPMM) -> None:
    weight = model.weight.detach() - 0.3
    reflection = torch.rand(len(model.lobe_model), generator=torch.Generator().manual_seed(1))
    found = non_negative(model, weight, reflection)
    assert float(found.min()) >= 0.0
    texel, size = entry_texels(model), reflection[model.index, None]
    zero = torch.zeros(model.texel_count, 3)
    wanted = zero.index_add(0, texel, weight * size).clamp(min=0.0)
    torch.testing.assert_close(zero.index_add(0, texel, found * size), wanted)
    untouched = ~(zero.index_add(0, texel, (weight < 0.0).float()).any(1))[texel]
    assert bool(untouched.any())
    torch.testing.assert_close(found[untouched], weight[untouched])


def test_look_of_nothing_falls_back_to_unit_colours(model: SPMM) -> None:
    nothing = select_texels(model, torch.zeros(8, 8))
    assert sample_look(model, nothing).colour.shape == (0, 3)
    edited = hue_saturation(model, 1.0, where=nothing)
    assert torch.equal(look(edited), look(model))


def test_identity_changes_nothing(model: SPMM) -> None:
    assert hue_saturation(model) is model
    assert hue_saturation(model, 2.0 * math.pi) is model


def test_bad_input(model: SPMM) -> None:
    with pytest.raises(ConfigError, match="saturation factor is 2.5; expected 0 to 2"):
        hue_saturation(model, 0.0, 2.5)
    with pytest.raises(ConfigError, match="hue is nan; expected a finite angle"):
        hue_saturation(model, float("nan"))
    with pytest.raises(ConfigError, match="fit is 'own'; expected one of material, unit"):
        hue_saturation(model, 1.0, fit="own")
