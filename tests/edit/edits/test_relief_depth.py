"""The relief flatter and deeper, and what other edits do to it."""

from __future__ import annotations

import pytest
import torch

from spmm_torch import SPMM, ConfigError
from spmm_torch.edit import (
    Rectangle,
    Script,
    blend,
    copy_look,
    intensity,
    lobe_selection,
    relief_depth,
    select_texels,
)
from spmm_torch.geometry.directions import MIRROR
from spmm_torch.model.relief import Relief
from tests.edit.looks import check_valid, look
from tests.planted.models import planted_relief, with_relief

# Half a step of the codes, of relief of 0.1, and of one twice as deep.
STEP = 0.2 / 255


@pytest.fixture
def rough(model: SPMM) -> SPMM:
    """The model over a relief of 0.1."""
    return with_relief(model, planted_relief(8, 8, 0.1, MIRROR))


def heights(model: SPMM) -> torch.Tensor:
    assert model.relief is not None
    return model.relief.heights(model.texel_count)


def test_heights_scale_about_their_mean(rough: SPMM) -> None:
    before = heights(rough)
    for factor in (0.5, 2.0):
        edited = relief_depth(rough, factor)
        expected = before.mean() + factor * (before - before.mean())
        torch.testing.assert_close(heights(edited), expected, rtol=0.0, atol=STEP)
        assert edited.relief is not None
        assert edited.relief.rule == MIRROR
        assert edited.weight.data_ptr() == rough.weight.data_ptr()
        check_valid(edited)
    assert not torch.allclose(look(relief_depth(rough, 2.0)), look(rough), rtol=0.05)


def test_a_model_edited_in_inference_mode_is_evaluated(rough: SPMM) -> None:
    expected = look(relief_depth(rough, 2.0))
    with torch.inference_mode():
        assert torch.equal(look(relief_depth(rough, 2.0)), expected)


def test_flat_is_the_mean_plane(rough: SPMM, model: SPMM) -> None:
    flat = relief_depth(rough, 0.0)
    plane = with_relief(model, Relief(None, 0.0, heights(rough).mean(), MIRROR))
    torch.testing.assert_close(look(flat), look(plane), rtol=1e-3, atol=1e-4)
    assert "relief.code" not in flat.to_tensors()[0]


def test_a_mask_holds(rough: SPMM) -> None:
    share = Rectangle(4, 0, 4, 8).mask(rough)
    edited = relief_depth(rough, 2.0, select_texels(rough, share))
    before, after = heights(rough), heights(edited)
    outside = share.flatten() == 0.0
    torch.testing.assert_close(after[outside], before[outside], rtol=0.0, atol=STEP)
    whole = heights(relief_depth(rough, 2.0))
    torch.testing.assert_close(after[~outside], whole[~outside], rtol=0.0, atol=STEP)


def test_scripts_scale_the_relief(rough: SPMM) -> None:
    script = Script.parse([{"relief_depth": {"factor": 2, "mask": {"cluster": {"number": 0}}}}])
    assert torch.equal(
        heights(script.apply(rough)),
        heights(relief_depth(rough, 2.0, select_texels(rough, (rough.labels == 0).float()))),
    )


def test_identity_changes_nothing(model: SPMM, rough: SPMM) -> None:
    assert relief_depth(model, 1.0) is model
    assert relief_depth(rough, 1.0) is rough


def test_bad_input(model: SPMM, rough: SPMM) -> None:
    with pytest.raises(ConfigError, match="has no relief"):
        relief_depth(model, 2.0)
    with pytest.raises(ConfigError, match="expected a finite number"):
        relief_depth(rough, -1.0)
    with pytest.raises(ConfigError, match="30 times as deep has heights"):
        relief_depth(rough, 30.0)
    with pytest.raises(ConfigError, match="takes whole texels"):
        relief_depth(rough, 2.0, lobe_selection(rough, specular=True))


def test_other_edits_keep_the_relief(rough: SPMM) -> None:
    edited = intensity(rough, 2.0, select_texels(rough, Rectangle(0, 0, 4, 8).mask(rough)))
    assert edited.relief is rough.relief
    torch.testing.assert_close(look(intensity(rough, 2.0)), 2.0 * look(rough))


def test_blends_mix_heights(model: SPMM, rough: SPMM) -> None:
    deeper = relief_depth(rough, 2.0)
    expected = 0.75 * heights(rough) + 0.25 * heights(deeper)
    torch.testing.assert_close(heights(blend(rough, deeper, 0.25)), expected, rtol=0.0, atol=STEP)
    half = 0.5 * heights(rough)
    torch.testing.assert_close(heights(blend(model, rough, 0.5)), half, rtol=0.0, atol=STEP)
    assert blend(model, model, 0.5).relief is None


def test_a_copied_look_brings_its_heights(rough: SPMM) -> None:
    target = select_texels(rough, Rectangle(4, 2, 3, 3).mask(rough))
    edited = copy_look(rough, Rectangle(0, 1, 3, 3), target)
    before, after = (heights(each).view(8, 8) for each in (rough, edited))
    torch.testing.assert_close(after[2:5, 4:7], before[1:4, 0:3], rtol=0.0, atol=STEP)
    torch.testing.assert_close(after[:, :4], before[:, :4], rtol=0.0, atol=STEP)
    check_valid(edited)
