"""How much lobes reflect, and that edits which keep it do."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
import torch

from spmm_torch import SPMM, load_btf
from spmm_torch.config.fit import FitConfig
from spmm_torch.data import sample_path
from spmm_torch.edit import scale_width, spread_normals
from spmm_torch.edit.energy import (
    FEWEST_SAMPLES,
    MOST_SAMPLES,
    energy_factors,
    mean_reflection,
    sample_count,
)
from spmm_torch.fit import fit
from spmm_torch.lobes.sampling import LobeTable, lobe_intensity
from tests.edit.looks import albedo
from tests.planted.lobes import Lobe, lobe_batch


def test_a_white_lobe_reflects_all() -> None:
    lobe = replace(lobe_batch(Lobe("lambertian")), horizon=0.0)
    found = mean_reflection(lobe, FEWEST_SAMPLES)
    expected = torch.tensor([1.0 / (2.0 * math.pi)])
    torch.testing.assert_close(found, expected, rtol=1e-3, atol=0.0)


@pytest.mark.parametrize("exponent", [1.0, 30.0, 900.0])
def test_narrow_lobes_that_lean_to_their_normal_are_met(exponent: float) -> None:
    """(n + 2) / (2 pi) (cos_i cos_o)^n cos_i, whose mean is 1 / (2 pi (n + 1))."""
    found = mean_reflection(lobe_batch(Lobe("lafortune", (0.0, exponent))), FEWEST_SAMPLES)
    expected = torch.tensor([1.0 / (2.0 * math.pi * (exponent + 1.0))])
    torch.testing.assert_close(found, expected, rtol=0.03, atol=0.0)


@pytest.mark.parametrize("spread", [0.0, 1.0, 8.0])
def test_the_same_mean_as_by_sampling_from_the_texel(model: SPMM, spread: float) -> None:
    """Tilted lobes too, of which the horizon of the texel hides a part."""
    lobes = spread_normals(model, spread).dictionary.detach()
    expected = lobe_intensity(lobes, LobeTable.build(lobes), 1 << 15)
    torch.testing.assert_close(mean_reflection(lobes, 4096), expected, rtol=0.02, atol=0.0)


def test_lobes_that_have_not_changed_keep_their_weight(model: SPMM) -> None:
    before = model.dictionary.detach()
    kappa = before.kappa.clone()
    kappa[3] *= 0.5
    changed = torch.arange(len(before)) == 3
    factor = energy_factors(before, replace(before, kappa=kappa), changed)
    assert (factor != 1.0).tolist() == changed.tolist()


def test_few_lobes_get_more_samples() -> None:
    counts = [sample_count(number) for number in (0, 1, 100, 700, 10**6)]
    assert counts == sorted(counts, reverse=True)
    assert counts[0] == counts[1] == MOST_SAMPLES
    assert counts[-1] == FEWEST_SAMPLES


@pytest.mark.parametrize("factor", [0.4, 1.5])
def test_kept_energy_keeps_the_albedo_of_tilted_lobes(model: SPMM, factor: float) -> None:
    tilted = spread_normals(model, 8.0)
    kept = scale_width(tilted, factor, keep_energy=True)
    torch.testing.assert_close(albedo(kept), albedo(tilted), rtol=0.02, atol=0.0)


@pytest.mark.slow
def test_kept_energy_keeps_the_albedo_of_a_fitted_model() -> None:
    """The bundled sample, whose normals tilt by up to 80 degrees."""
    parts = {"cluster": {"count": 8}, "sample": {"per_cluster": 2}}
    search = {"exchanges": 0, "max_lobes": 3, "restarts": 1, "bank_normals": 24}
    config = FitConfig.from_dict({"device": "cpu", **parts, "search": search})
    fitted = fit(load_btf(sample_path()), config, render=False).model
    assert fitted.normal[:, 2].min().item() < 0.5
    for factor in (0.4, 1.5):
        kept = scale_width(fitted, factor, keep_energy=True)
        torch.testing.assert_close(albedo(kept), albedo(fitted), rtol=0.02, atol=0.0)
        plain = albedo(scale_width(fitted, factor))
        assert float((plain / albedo(fitted) - 1.0).abs().max()) > 0.05
