"""Widths scaled."""

from __future__ import annotations

import pytest
import torch

from spmm_torch import SPMM, ConfigError
from spmm_torch.brdf import MODEL_NAMES, REGISTRY
from spmm_torch.edit import lobe_group, scale_width, widths
from spmm_torch.edit.edits.scale_width import scaled_widths
from tests.edit.looks import albedo, check_valid


def test_widths_scale_in_every_model(model: SPMM) -> None:
    lobes = model.dictionary.detach()
    before, after = widths(lobes), widths(scaled_widths(lobes, 0.5))
    has = before.isfinite()
    torch.testing.assert_close(after[has], 0.5 * before[has])
    names = {name for name, finite in zip(lobes.names(), has.tolist(), strict=True) if finite}
    assert names == set(MODEL_NAMES[2:7])


def test_narrowing_and_widening_return(model: SPMM) -> None:
    back = scale_width(scale_width(model, 0.7), 1.0 / 0.7)
    torch.testing.assert_close(back.kappa, model.kappa)


def test_narrowing_is_kept_to_its_group(model: SPMM) -> None:
    where = lobe_group(model, "specular")
    edited = scale_width(model, 0.5, where)
    chosen = where.lobes
    assert chosen is not None
    assert torch.equal(edited.kappa[~chosen], model.kappa[~chosen])
    assert widths(edited.dictionary)[chosen].max().item() < 0.26
    assert edited.weight.data_ptr() == model.weight.data_ptr()
    check_valid(edited)


def test_widths_stay_within_their_bounds(model: SPMM) -> None:
    for factor in (1e-3, 1e3):
        edited = scale_width(model, factor)
        for index, kappa in zip(edited.lobe_model.tolist(), edited.kappa, strict=True):
            for column, row in enumerate(REGISTRY[index].parameters):
                assert row.low * (1.0 - 1e-6) <= kappa[column].item() <= row.high * (1.0 + 1e-6)
        check_valid(edited)


@pytest.mark.parametrize("factor", [0.5, 1.5])
def test_kept_energy_keeps_the_albedo(model: SPMM, factor: float) -> None:
    kept = scale_width(model, factor, keep_energy=True)
    torch.testing.assert_close(albedo(kept), albedo(model), rtol=0.02, atol=0.0)
    plain = albedo(scale_width(model, factor))
    assert float((plain / albedo(model) - 1.0).abs().max()) > 0.02  # without, it changes
    check_valid(kept)


def test_identity_changes_nothing(model: SPMM) -> None:
    assert scale_width(model, 1.0) is model


@pytest.mark.parametrize(
    ("factor", "complaint"),
    [
        (0.0, "width is 0; expected a positive number"),
        (-1.0, "width is -1.0; expected a finite number"),
    ],
)
def test_bad_factors(model: SPMM, factor: float, complaint: str) -> None:
    with pytest.raises(ConfigError, match=complaint):
        scale_width(model, factor)
