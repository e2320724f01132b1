"""Blends of two models."""

from __future__ import annotations

import pytest
import torch

from spmm_torch import SPMM, ConfigError
from spmm_torch.edit import (
    Stripes,
    blend,
    intensity,
    lobe_group,
    lobe_selection,
    select_texels,
    spread_normals,
)
from tests.edit.looks import check_valid, look
from tests.planted.models import FEW_RINGS, planted_model


@pytest.fixture
def other() -> SPMM:
    return planted_model(clusters=4, lobes_per_cluster=5, rings=FEW_RINGS, residual=0.05, seed=8)


@pytest.mark.parametrize("amount", [0.25, 0.7])
def test_lobes_blend_exactly(model: SPMM, other: SPMM, amount: float) -> None:
    mixed = blend(model, other, amount)
    expected = (1.0 - amount) * look(model, False) + amount * look(other, False)
    torch.testing.assert_close(look(mixed, residual=False), expected, rtol=1e-4, atol=1e-5)
    check_valid(mixed)


def test_residual_blends_to_the_mean_of_each_cluster(model: SPMM, other: SPMM) -> None:
    mixed = blend(model, other, 0.3)
    assert torch.equal(mixed.labels, model.labels)
    epsilon = [look(each) - look(each, residual=False) for each in (model, other, mixed)]
    wanted = 0.7 * epsilon[0] + 0.3 * epsilon[1]
    for cluster in range(2):
        members = model.labels == cluster
        mean = wanted[:, members].mean(1, keepdim=True)
        torch.testing.assert_close(
            epsilon[2][:, members], mean.expand_as(epsilon[2][:, members]), rtol=1e-3, atol=1e-4
        )


def test_ends_of_a_blend_are_the_models(model: SPMM, other: SPMM) -> None:
    assert blend(model, other, 0.0) is model
    torch.testing.assert_close(look(blend(model, other, 1.0)), look(other))


def test_blend_with_an_edited_self_shares_the_dictionary(model: SPMM) -> None:
    mixed = blend(model, intensity(model, 3.0), 0.5)
    assert len(mixed.lobe_model) == len(model.lobe_model)
    torch.testing.assert_close(look(mixed), 2.0 * look(model), rtol=1e-4, atol=1e-5)


def test_blend_under_a_mask(model: SPMM, other: SPMM) -> None:
    mask = Stripes(1, 0.5, 0.5).mask(model)
    mixed = blend(model, other, 1.0, select_texels(model, mask))
    share = mask.flatten()[None, :, None]
    expected = (1.0 - share) * look(model, False) + share * look(other, False)
    torch.testing.assert_close(look(mixed, residual=False), expected, rtol=1e-4, atol=1e-5)
    hard = blend(model, other, 1.0, select_texels(model, mask > 0.5))
    inside = (mask > 0.5).flatten()
    torch.testing.assert_close(look(hard)[:, inside], look(other)[:, inside])
    torch.testing.assert_close(look(hard)[:, ~inside], look(model)[:, ~inside])
    for each in (mixed, hard):
        check_valid(each)


def test_bad_input(model: SPMM, other: SPMM) -> None:
    with pytest.raises(ConfigError, match="8 x 8 texels with 3 channels and 6 x 6 texels"):
        blend(model, planted_model(size=6, rings=FEW_RINGS), 0.5)
    with pytest.raises(ConfigError, match="different light directions"):
        blend(model, planted_model(rings=((0.0, 1), (20.0, 6), (60.0, 10))), 0.5)
    hard = planted_model(rings=FEW_RINGS)
    hard.horizon = 0.0
    with pytest.raises(ConfigError, match="fade over 2 and 0 degrees at their horizon"):
        blend(model, hard, 0.5)
    with pytest.raises(ConfigError, match="amount of a blend is 1.5; expected 0 to 1"):
        blend(model, other, 1.5)
    for where in (lobe_selection(model, specular=True), lobe_group(model, "specular")):
        with pytest.raises(ConfigError, match="a blend takes whole texels"):
            blend(model, other, 0.5, where)


def test_edits_after_a_blend(model: SPMM, other: SPMM) -> None:
    check_valid(spread_normals(blend(model, other, 0.5), 1.5))
