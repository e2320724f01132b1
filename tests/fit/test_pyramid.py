"""A pyramid is fit to means of values, level by level."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from skimage.transform import downscale_local_mean

from spmm_torch import BTF, ConfigError, FitConfig
from spmm_torch.data.scattered_btf import ScatteredBTF
from spmm_torch.fit.pyramid import fit_pyramid, halved
from spmm_torch.geometry.directions import ring_directions
from tests.fit.test_units import SETTINGS
from tests.planted.btfs import random_btf
from tests.planted.settings import FLAT

RINGS = ring_directions(((0.0, 1), (35.0, 5), (60.0, 6)))


def test_halves_are_means_of_areas() -> None:
    btf = random_btf(RINGS[:2], 4, 6, RINGS[:3])
    half = halved(btf)
    assert (half.height, half.width) == (2, 3)
    for view in range(3):
        expected = downscale_local_mean(btf.pictures(view).numpy(), (1, 2, 2, 1))
        np.testing.assert_allclose(half.pictures(view).numpy(), expected, rtol=1e-6)
    assert (halved(random_btf(RINGS[:2], 5, 1)).height, halved(half).width) == (2, 1)


def test_levels_are_fit_to_means() -> None:
    row = torch.arange(4)[:, None] + torch.arange(4)
    albedo = torch.stack((row % 2, 1.0 - row % 2, 0.5 * torch.ones(4, 4)), dim=-1)  # a checkerboard
    values = albedo / torch.pi * RINGS[:, 2].view(1, -1, 1, 1, 1).expand(len(RINGS), -1, 1, 1, 1)
    btf = BTF.from_values(values.contiguous(), RINGS, RINGS)
    diffuse = {"search": {**SETTINGS["search"], "models": ["lambertian"]}}
    pyramid = fit_pyramid(btf, FitConfig.from_dict(SETTINGS | FLAT | diffuse))
    assert [(level.height, level.width) for level in pyramid.levels] == [(4, 4), (2, 2), (1, 1)]
    above = torch.tensor([0.0, 0.0, 1.0])
    for texels, expected in ((2.0, 0.5), (4.0, 0.5)):
        found = pyramid(torch.tensor([0.3, 0.7]), above, above, torch.tensor(texels / 4))
        torch.testing.assert_close(found * torch.pi, torch.full((3,), expected), rtol=0.02, atol=0)


def test_what_has_the_size_of_the_finest_level_is_refused_at_once(tmp_path: Path) -> None:
    """The second level refused it, once the finest one had been fit."""
    btf, texel = random_btf(RINGS, 4, 4), tmp_path / "weights.npz"
    np.savez(texel, allow_pickle=False, texel=np.ones((4, 4)))
    for settings, name in (
        ({"relief": {"height": "h.png"}}, "relief.height"),
        ({"weights": {"file": str(texel)}}, "texel of weights.file"),
    ):
        with pytest.raises(ConfigError, match=f"^{name} of the settings is for 4 x 4 texels; "):
            fit_pyramid(btf, FitConfig.from_dict(settings))
    samples = ScatteredBTF.from_samples(RINGS, RINGS, torch.rand(4, len(RINGS), 3))
    samples = replace(samples, names=None, height=2, width=2)
    with pytest.raises(ConfigError, match="scattered samples; expected a grid"):
        fit_pyramid(samples)


def test_a_number_of_levels_is_kept_or_refused() -> None:
    btf = random_btf(RINGS, 2, 2)
    assert len(fit_pyramid(btf, FitConfig.from_dict(SETTINGS | FLAT), levels=1).levels) == 1
    with pytest.raises(ConfigError, match=r"^levels of a pyramid are 0; expected 1 at least\.$"):
        fit_pyramid(btf, levels=0)
