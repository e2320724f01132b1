"""Intensity: of everything, of a group, and under masks."""

from __future__ import annotations

import pytest
import torch

from spmm_torch import SPMM, ConfigError
from spmm_torch.edit import Stripes, intensity, lobe_group, lobe_selection, select_texels
from spmm_torch.edit.entries import entry_texels
from spmm_torch.edit.residual import STEPS
from spmm_torch.render import Camera, DirectionalLight, RenderSettings, Scene, Sphere, render
from tests.edit.looks import check_valid, look


@pytest.mark.parametrize("factor", [0.0, 0.5, 4.0])
def test_intensity_scales_renders_exactly(model: SPMM, factor: float) -> None:
    """By powers of two, to the bit, residual included."""
    scene = Scene(Sphere(), Camera.orthographic(), (DirectionalLight.build((0.4, 0.3, 1.0)),))
    settings = RenderSettings(size=16, samples=1)
    edited = intensity(model, factor)
    before, after = (render(each, scene, settings).picture for each in (model, edited))
    assert torch.equal(after, factor * before)
    check_valid(edited)


def test_any_factor_scales_within_rounding(model: SPMM) -> None:
    torch.testing.assert_close(look(intensity(model, 1.3)), 1.3 * look(model))


def test_what_is_not_edited_is_shared(model: SPMM) -> None:
    edited = intensity(model, 2.0)
    for name in ("kappa", "normal", "angle", "index", "labels"):
        assert getattr(edited, name).data_ptr() == getattr(model, name).data_ptr()
    assert edited.residual.code.data_ptr() == model.residual.code.data_ptr()


@pytest.mark.parametrize("group", ["specular", "non_specular"])
def test_a_group_leaves_other_lobes_and_the_residual(model: SPMM, group: str) -> None:
    where = lobe_group(model, group)
    edited = intensity(model, 3.0, where)
    assert where.lobes is not None
    chosen = where.lobes[model.index]
    assert torch.equal(edited.weight[~chosen], model.weight[~chosen])
    assert torch.equal(edited.weight[chosen], 3.0 * model.weight[chosen])
    assert torch.equal(edited.residual.scale, model.residual.scale)


def test_hard_mask_touches_only_its_texels(model: SPMM) -> None:
    mask = torch.zeros(8, 8)
    mask[2:5, 1:6] = 1.0
    edited = intensity(model, 2.0, select_texels(model, mask))
    inside = mask.flatten() > 0.0
    for each, factor in ((~inside, 1.0), (inside, 2.0)):
        entries = each[entry_texels(model)]
        assert torch.equal(edited.weight[entries], factor * model.weight[entries])
        torch.testing.assert_close(look(edited)[:, each], factor * look(model)[:, each])
    assert edited.cluster_count == 2 + 2  # both clusters are cut
    check_valid(edited)


def test_soft_mask_blends_weights_and_steps_the_residual(model: SPMM) -> None:
    """Lobes follow the mask exactly; the residual by half a step of it at the most."""
    mask = Stripes(1, 0.5, 0.5).mask(model)
    edited = intensity(model, 3.0, select_texels(model, mask))
    share = mask.flatten()[None, :, None]
    lobes, whole = look(model, residual=False), look(model)
    torch.testing.assert_close(look(edited, residual=False), (1.0 + 2.0 * share) * lobes)
    epsilon = whole - lobes
    error = (look(edited) - look(edited, residual=False)) - (1.0 + 2.0 * share) * epsilon
    assert bool((error.abs() <= 2.0 * epsilon.abs() / STEPS + 1e-6).all())
    assert edited.cluster_count > 4
    check_valid(edited)


def test_a_group_under_a_mask(model: SPMM) -> None:
    """Specular lobes inside of the mask, and nothing else."""
    mask = Stripes(2, 0.5).mask(model)
    where = select_texels(model, mask) & lobe_group(model, "specular")
    edited = intensity(model, 3.0, where)
    assert where.lobes is not None
    chosen = where.lobes[model.index] & (mask.flatten() > 0.0)[entry_texels(model)]
    assert torch.equal(edited.weight[~chosen], model.weight[~chosen])
    assert torch.equal(edited.weight[chosen], 3.0 * model.weight[chosen])
    assert torch.equal(edited.residual.scale, model.residual.scale)


def test_a_selection_by_lobes_leaves_the_residual(model: SPMM) -> None:
    edited = intensity(model, 0.0, lobe_selection(model, models=["ward", "lambertian"]))
    assert edited.residual.scale is not None
    assert torch.equal(edited.residual.scale, model.residual.scale)
    kept = edited.weight.any(1)
    names = model.dictionary.names()
    assert {names[j] for j in model.index[kept].tolist()}.isdisjoint({"ward", "lambertian"})


def test_identity_changes_nothing(model: SPMM) -> None:
    assert intensity(model, 1.0) is model


@pytest.mark.parametrize("factor", [-1.0, float("nan"), float("inf")])
def test_bad_factors(model: SPMM, factor: float) -> None:
    with pytest.raises(ConfigError, match=r"is (-1.0|nan|inf); expected a finite number"):
        intensity(model, factor)
