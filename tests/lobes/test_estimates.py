"""What the samplers of single lobes are for: estimates that are right, with bounded weights."""

from __future__ import annotations

import math

import pytest
import torch

from spmm_torch.brdf import MODEL_NAMES, REGISTRY
from spmm_torch.geometry.directions import direction_from_angles
from spmm_torch.lobes.sampling import LobeTable, lobe_intensity
from tests.chi2 import Grid
from tests.lobes.lobe_cases import CASES, KAPPA, Case, lobe


@pytest.mark.parametrize("case", CASES)
def test_albedo_by_sampling_is_that_of_quadrature(case: Case) -> None:
    points = torch.quasirandom.SobolEngine(3, scramble=True, seed=3).draw(1 << 15)
    wi = case.sample(points.double())
    estimate = float((case.rho(wi) / case.pdf(wi)).mean())
    exact = float(Grid.around(wi[:10_000], 32, 64).integrate(case.rho, 100_000).sum())
    assert estimate == pytest.approx(exact, rel=5e-3)


@pytest.mark.parametrize("case", CASES)
def test_weights_are_bounded(case: Case) -> None:
    u = torch.rand(20_000, 3, generator=torch.Generator().manual_seed(1), dtype=torch.float64)
    wi = case.sample(u)
    weight = case.rho(wi) / case.pdf(wi)
    assert bool(weight.isfinite().all())
    bound = REGISTRY[int(case.lobes.model)].largest_weight
    assert float(weight.max()) <= bound + 1e-9, "raise largest_weight, or sample closer to the lobe"


@pytest.mark.parametrize("name", MODEL_NAMES)
def test_intensity_is_the_mean_over_light_and_view(name: str) -> None:
    """Against a plain sum over random pairs, for wide lobes, where that converges."""
    lobes = lobe(name, KAPPA[name]["wide"], 30.0)
    generator = torch.Generator().manual_seed(4)
    u = torch.rand(2, 1 << 18, 2, generator=generator, dtype=torch.float64)
    wi, wo = direction_from_angles(torch.arccos(u[..., 0]), 2.0 * math.pi * u[..., 1])
    expected = float(lobes.eval(wi[None], wo[None]).mean())
    found = float(lobe_intensity(lobes, LobeTable.build(lobes)))
    # Without the square root, Ward's albedo grows so fast towards grazing that its mean is rough.
    assert found == pytest.approx(expected, rel=0.15 if name == "ward_duer" else 0.05)
