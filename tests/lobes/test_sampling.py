"""Samplers of single rotated lobes against their densities, and at every edge."""

from __future__ import annotations

from zlib import crc32

import pytest
import torch

from spmm_torch.lobes.batch import LobeBatch
from spmm_torch.lobes.sampling import LobeTable, specular_mask
from tests.chi2 import check
from tests.lobes.lobe_cases import CASES, KAPPA, Case, lobe, unit_vector

NARROW = [param for param in CASES if "narrow" in param.id]


def seed(request: pytest.FixtureRequest) -> int:
    """Different numbers for every test, the same in every run."""
    return crc32(request.node.name.encode())


@pytest.mark.parametrize("case", CASES)
def test_chi_square(case: Case, request: pytest.FixtureRequest) -> None:
    outcome = check(case.sample, case.pdf, 50_000, 16, 32, seed(request))
    assert outcome.accepted, outcome
    assert outcome.cells > 50


@pytest.mark.slow
@pytest.mark.parametrize("case", CASES)
def test_chi_square_of_a_million(case: Case, request: pytest.FixtureRequest) -> None:
    outcome = check(case.sample, case.pdf, 1_000_000, 100, 200, seed(request))
    assert outcome.accepted, outcome
    assert outcome.cells > 1000


@pytest.mark.parametrize("case", NARROW)
def test_chi_square_in_float32(case: Case, request: pytest.FixtureRequest) -> None:
    """The density is taken in float32 too: narrow lobes must not lose their digits."""

    def sample(u: torch.Tensor) -> torch.Tensor:
        return case.sample(u.float().clamp(max=1.0 - 2.0**-24)).double()

    def pdf(wi: torch.Tensor) -> torch.Tensor:
        return case.pdf(wi.float()).double()

    outcome = check(sample, pdf, 50_000, 16, 32, seed(request))
    assert outcome.accepted, outcome


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64], ids=str)
@pytest.mark.parametrize("polar", [0.0, 60.0, 89.0, 89.99, 90.0, 100.0])
def test_edges_of_the_square_and_of_the_hemisphere(polar: float, dtype: torch.dtype) -> None:
    """Also views under the lobe's horizon, where any density will do as long as it is one."""
    last = 1.0 - torch.finfo(dtype).eps / 2.0
    edge = torch.tensor([0.0, 0.5, last], dtype=dtype)
    u = torch.cartesian_prod(edge, edge, edge)
    for name, widths in KAPPA.items():
        for kappa in widths.values():
            for tilt in (0.0, 35.0, 85.0):
                case = Case(lobe(name, kappa, tilt), unit_vector(polar, 0.3))
                wi = case.sample(u)
                density = case.pdf(wi)
                assert wi.dtype == density.dtype == dtype
                assert bool((wi[:, 2] > 0.0).all())
                torch.testing.assert_close(wi.norm(dim=1), torch.ones(27, dtype=dtype))
                assert bool((density.isfinite() & (density >= 0.0)).all())


def test_density_is_zero_under_the_texels_horizon() -> None:
    below = unit_vector(95.0, 1.0)[None]
    for name, widths in KAPPA.items():
        assert float(Case(lobe(name, widths["wide"], 35.0), unit_vector(40.0, 0.3)).pdf(below)) == 0


def test_a_table_samples_each_entry_by_its_own_lobe() -> None:
    cases = [
        Case(lobe(name, widths["wide"], 20.0), unit_vector(40.0, 0.3))
        for name, widths in KAPPA.items()
    ]
    table = LobeTable.build(LobeBatch.cat([case.lobes for case in cases]))
    generator = torch.Generator().manual_seed(2)
    index = torch.randint(len(cases), (300,), generator=generator)
    u = torch.rand(300, 3, generator=generator, dtype=torch.float64)
    wo = cases[0].wo.expand(300, 3)
    wi = table.sample(index, wo, u)
    density = table.pdf(index, torch.arange(len(index)), wi, wo)
    for position, case in enumerate(cases):
        rows = index == position
        torch.testing.assert_close(wi[rows], case.sample(u[rows]))
        torch.testing.assert_close(density[rows], case.pdf(wi[rows]))


def test_specular_lobes_are_the_narrow_ones() -> None:
    for name, widths in KAPPA.items():
        mask = {
            width: bool(specular_mask(lobe(name, kappa, 0.0))) for width, kappa in widths.items()
        }
        assert mask.get("narrow", True)
        if "narrow" not in widths:
            assert not mask["wide"]
    assert not bool(specular_mask(lobe("blinn_phong", (4.0,), 0.0)))
    assert bool(specular_mask(lobe("ward", (0.9, 0.1), 0.0)))
