"""No more model than pays, and what every model buys."""

from __future__ import annotations

import pytest
import torch

from spmm_torch import BTF, FitConfig
from spmm_torch.errors import DataError
from spmm_torch.fit import FitResult, fit
from spmm_torch.fit.prune.auto import held_out
from spmm_torch.geometry.directions import ring_directions
from spmm_torch.report import check_report
from tests.planted.btfs import tabulated, texel_btf
from tests.planted.models import planted_model

RINGS = ((0.0, 1), (25.0, 6), (50.0, 10), (75.0, 14))
DIRECTIONS = ring_directions(RINGS)
COUNT, SIDE = len(DIRECTIONS), 6
CONFIG = FitConfig.from_dict(
    {
        "cluster": {"count": 2},
        "sample": {"per_cluster": 3},
        "search": {
            "models": ["lambertian", "oren_nayar", "blinn_phong", "ward"],
            "max_lobes": 2,
            "restarts": 2,
            "bank_normals": 24,
            "exchanges": 0,
            "final_steps": 8,
        },
        "select": {"min_gain": 0.001},
        "device": "cpu",
        "auto": True,
    }
)


def diffuse(noise: float, gamma: float | None) -> BTF:
    """A uniform Lambertian material, with noise, as 8-bit codes would have it."""
    generator = torch.Generator().manual_seed(0)
    values = 0.5 * DIRECTIONS[:, 2].repeat(COUNT)[:, None] * torch.tensor([1.0, 0.7, 0.4])
    values = values.expand(SIDE * SIDE, -1, 3)
    values = values * (1.0 + noise * torch.randn(values.shape, generator=generator))
    if gamma is not None:
        values = ((values.clamp(0.0, 1.0) ** (1.0 / gamma) * 255.0).round() / 255.0) ** gamma
    return texel_btf(values, DIRECTIONS, height=SIDE)


@pytest.mark.parametrize(("noise", "gamma"), [(0.0, None), (0.0, 2.2), (0.05, 2.2)])
def test_a_uniform_diffuse_material_has_one_lobe_a_texel(noise: float, gamma: float | None) -> None:
    report = fit(diffuse(noise, gamma), CONFIG, render=False).report
    check_report(report)
    assert report["mean_basis_per_texel"] == 1.0
    assert len(report["auto"]["models"]) == 1
    assert report["auto"]["min_gain"] > CONFIG.select.min_gain
    assert report["snr_db"]["without_residual"] > 25.0


@pytest.fixture(scope="module")
def glossy() -> FitResult:
    """Of texels that have a Ward and a Lambertian lobe each."""
    model = planted_model(
        size=SIDE,
        lobes_per_texel=2,
        lobes_per_cluster=2,
        rings=RINGS,
        names=("lambertian", "ward"),
        seed=5,
    )
    return fit(tabulated(model), CONFIG, render=False)


def test_what_pays_is_kept(glossy: FitResult) -> None:
    assert "ward" in glossy.report["auto"]["models"]
    assert glossy.report["mean_basis_per_texel"] <= 2.5
    assert glossy.report["snr_db"]["without_residual"] > 25.0


def test_the_report_says_what_a_model_buys(glossy: FitResult) -> None:
    worth = glossy.report["error_without_model"]
    assert worth["texels"] == SIDE * SIDE  # all of them
    assert worth["snr_db"] > worth["snr_db_without"]["ward"] + 3.0
    assert set(worth["snr_db_without"]) <= set(glossy.report["auto"]["models"])


def test_held_out_directions_are_whole_views_and_lights() -> None:
    held = held_out(diffuse(0.0, None), torch.Generator().manual_seed(1))
    view, light = held.all(1), held.all(0)
    assert (int(view.sum()), int(light.sum())) == (3, 3)  # a tenth of 31
    assert torch.equal(held, view[:, None] | light)


def test_few_directions_cannot_be_held_out() -> None:
    few = DIRECTIONS[:3]
    values = torch.rand(3, 3, 2, 2, 3, generator=torch.Generator().manual_seed(0))
    with pytest.raises(DataError, match="has 3 views and 3 lights; auto expected at least 4"):
        fit(BTF.from_values(values, few, few), CONFIG, render=False)
