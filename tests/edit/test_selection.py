"""Selections: what they select, how they combine, and what they refuse."""

from __future__ import annotations

import pytest
import torch

from spmm_torch import SPMM, ConfigError
from spmm_torch.edit import (
    EVERYTHING,
    Selection,
    lobe_group,
    lobe_selection,
    select_lobes,
    select_texels,
)
from spmm_torch.edit.entries import entry_texels


def random_mask(model: SPMM, seed: int) -> Selection:
    """Random shares of all texels."""
    return select_texels(model, torch.rand(64, generator=torch.Generator().manual_seed(seed)))


def test_entries_follow_their_texels(model: SPMM) -> None:
    mask = torch.rand(8, 8, generator=torch.Generator().manual_seed(4))
    where = select_texels(model, mask)
    assert torch.equal(where.texels, mask.flatten())
    assert torch.equal(where.entries, mask.flatten()[entry_texels(model)])
    assert torch.equal(select_texels(model, mask.flatten()).entries, where.entries)
    assert set(select_texels(model, mask > 0.5).entries.tolist()) == {0.0, 1.0}


def test_combinations(model: SPMM) -> None:
    a, b = random_mask(model, 1), random_mask(model, 2)
    torch.testing.assert_close((a & b).texels, a.texels * b.texels)
    torch.testing.assert_close((a | b).entries, torch.maximum(a.entries, b.entries))
    torch.testing.assert_close((~a).texels, 1.0 - a.texels)
    specular = lobe_selection(model, specular=True)
    for mixed in (a & specular, specular | b, ~specular):
        assert mixed.texels is None
    assert torch.equal((a & specular).entries, a.entries * specular.entries)


def test_everything_is_neutral(model: SPMM) -> None:
    mask, group = random_mask(model, 1), lobe_group(model, "specular")
    for selection in (mask, group, mask & group, lobe_selection(model, specular=True)):
        for combined in (EVERYTHING & selection, selection & EVERYTHING):
            assert combined.entries is selection.entries
            assert combined.texels is selection.texels
            assert combined.lobes is selection.lobes
    assert EVERYTHING.entry_share(model) is None
    assert torch.equal(EVERYTHING.texel_share(model, "this"), torch.ones(64))


def test_a_mask_and_a_group_multiply(model: SPMM) -> None:
    mask, group = random_mask(model, 1), lobe_group(model, "specular")
    both = mask & group
    share, expected = both.entry_share(model), mask.entries
    assert share is not None
    assert group.lobes is not None
    assert expected is not None
    assert torch.equal(share, expected * group.lobes[model.index])
    assert torch.equal((group & mask).entry_share(model), share)


def test_only_whole_texels_reach_the_residual(model: SPMM) -> None:
    mask, group = random_mask(model, 1), lobe_group(model, "specular")
    properties = lobe_selection(model, specular=True)
    for selection in (EVERYTHING, mask, mask | mask, ~mask):
        assert selection.reaches_residual
    for selection in (group, mask & group, properties, mask & properties, ~properties):
        assert not selection.reaches_residual
        with pytest.raises(ConfigError, match="this takes whole texels"):
            selection.texel_share(model, "this")


def test_groups_of_both_selections(model: SPMM) -> None:
    specular, other = (lobe_group(model, name) for name in ("specular", "non_specular"))
    share = (specular & other).entry_share(model)
    assert share is not None
    assert not bool(share.any())


def test_only_masks_are_joined_or_inverted(model: SPMM) -> None:
    mask, group = random_mask(model, 1), lobe_group(model, "specular")
    for wrong in (
        lambda: mask | group,
        lambda: (mask & group) | mask,
        lambda: ~group,
        lambda: ~EVERYTHING,
    ):
        with pytest.raises(ConfigError, match="combine masks first"):
            wrong()


def test_wrong_sizes_and_values(model: SPMM) -> None:
    with pytest.raises(ConfigError, match="mask has 7 x 8 texels, the texture 8 x 8"):
        select_texels(model, torch.ones(8, 7))
    for value in (1.5, -0.1, float("nan")):
        with pytest.raises(ConfigError, match="outside of 0 to 1"):
            select_texels(model, torch.full((8, 8), value))
    with pytest.raises(ConfigError, match="has 3 values; expected one for each of the 12 lobes"):
        select_lobes(model, torch.ones(3, dtype=torch.bool))
