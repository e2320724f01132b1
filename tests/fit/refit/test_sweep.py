"""Functions for given coefficients, and of clusters, against dense least squares."""

from __future__ import annotations

import math

import pytest
import torch
from torch import Tensor
from torch.nn.functional import one_hot

from spmm_torch.config.fit import FitConfig
from spmm_torch.data import BTF
from spmm_torch.fit import fit
from spmm_torch.fit.refit import sweep as sweeps
from spmm_torch.fit.refit.cluster_functions import LeftOver, left_over
from spmm_torch.fit.refit.sweep import Swept, sweep
from spmm_torch.runtime.ranks import ALONE
from tests.fit.refit.refit_cases import CASES, LIGHT, VIEW, Case, silent

RANK, CLUSTERS = 3, 4


@pytest.fixture(params=CASES)
def sample(request: pytest.FixtureRequest) -> Case:
    return CASES[request.param]


def coefficient(sample: Case) -> Tensor:
    generator = torch.Generator().manual_seed(5)
    return torch.randn(sample.pictures.texel_count, RANK, generator=generator)


def left_by_lobes(sample: Case) -> Tensor:
    """What the lobes leave `[V, T, L, C]` float64, without weights of pairs."""
    shown = torch.einsum("vpln,nc->vplc", sample.lobe_design(), sample.entries.weight.double())
    return (sample.values() - shown) / sample.pair_scale()[:, None, :, None]


def swept(sample: Case, *, exact: bool) -> Swept:
    return sweep(
        sample.pictures,
        sample.scale,
        sample.lookups,
        sample.entries,
        sample.rho,
        coefficient(sample),
        ALONE,
        silent,
        exact=exact,
    )


@pytest.mark.parametrize("exact", [True, False])
def test_functions_are_those_of_least_squares(
    sample: Case, exact: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sweeps, "RIDGE", 1e-9)
    seen = sample.shown() @ coefficient(sample).double()  # [V, T, R]
    left = left_by_lobes(sample)
    expected = torch.linalg.lstsq(seen, left.flatten(2)).solution  # [V, R, L C]
    found = swept(sample, exact=exact).functions
    torch.testing.assert_close(found.double().flatten(2), expected, rtol=1e-3, atol=1e-3)


@pytest.mark.parametrize("exact", [True, False])
def test_products_with_what_the_lobes_leave(sample: Case, exact: bool) -> None:
    found = swept(sample, exact=exact)
    shown = sample.component_design(found.functions).flatten(4)  # [V, T, L, C, T R]
    left = left_by_lobes(sample) * sample.pair_scale()[:, None, :, None]
    expected = torch.einsum("vplcm,vplc->m", shown, left).view(-1, RANK)
    torch.testing.assert_close(found.products, expected, rtol=1e-4, atol=1e-4)


def test_pictures_of_one_value_are_left_as_they_are() -> None:
    """A single texel and pair need no transposition: a picture may be of the store itself."""
    up = torch.tensor([[0.0, 0.0, 1.0]])
    btf = BTF.from_values(torch.full((1, 1, 1, 1, 3), 0.2), up, up)
    fit(btf, FitConfig(), render=False)
    assert btf.texels().flatten().tolist() == pytest.approx([0.2] * 3)


def labels(sample: Case) -> Tensor:
    return torch.arange(sample.pictures.texel_count) // 2 % CLUSTERS


def left_beside(sample: Case, components: tuple[Tensor, Tensor] | None = None) -> LeftOver:
    return left_over(
        sample.pictures,
        sample.lookups,
        sample.entries,
        sample.rho,
        labels(sample),
        ALONE,
        silent,
        components=components,
    )


@pytest.mark.parametrize("beside", [False, True], ids=["alone", "beside components"])
def test_functions_of_clusters(sample: Case, beside: bool) -> None:
    left, components = left_by_lobes(sample), None
    if beside:
        own = coefficient(sample)
        functions = swept(sample, exact=True).functions
        components = functions, own
        shown = sample.component_design(functions).flatten(4) @ own.double().flatten()
        left = left - shown / sample.pair_scale()[:, None, :, None]
    seen = sample.shown() @ one_hot(labels(sample)).double()  # [V, T, K]
    expected = torch.linalg.lstsq(seen, left.flatten(2)).solution  # [V, K, L C]
    over = left_beside(sample, components)
    found = over.functions()
    assert found.shape == (CLUSTERS, len(VIEW), len(LIGHT), 3)
    found_rows = found.transpose(0, 1).flatten(2)
    torch.testing.assert_close(found_rows.double(), expected, rtol=1e-3, atol=1e-3)
    scale = sample.pair_scale()[:, None, :, None]
    for functions, error in ((None, left), (found, left - (seen @ expected).view_as(left))):
        total = float((error * scale).square().sum())
        assert over.error(functions, sample.scale) == pytest.approx(total, rel=1e-4)
    total = float(sample.values().square().sum())
    assert over.value_energy(sample.scale) == pytest.approx(total, rel=1e-5)


def test_functions_of_clusters_are_mean_errors_of_a_flat_surface() -> None:
    sample = CASES["flat"]
    left = left_by_lobes(sample)
    own = labels(sample)
    mean = torch.stack([left[:, own == k].mean(1) for k in range(CLUSTERS)]).float()
    found = left_beside(sample).functions()
    torch.testing.assert_close(found, mean, rtol=1e-4, atol=1e-4)


def test_error_of_cluster_means(sample: Case) -> None:
    own, values = labels(sample), sample.values() / sample.pair_scale()[:, None, :, None]
    weight = torch.ones(len(own)) if sample.importance is None else sample.importance
    root = weight.double().sqrt()
    member = one_hot(own).double() * root[:, None]
    rows = values.transpose(0, 1).flatten(1)
    best = torch.linalg.lstsq(member, rows).solution
    left = (rows - member @ best).view(values.transpose(0, 1).shape)
    total = float((left * sample.pair_scale()[:, :, None]).square().sum())
    assert left_beside(sample).mean_error(sample.scale) == pytest.approx(total, rel=1e-4)


def test_a_cluster_that_no_pixel_shows_has_no_error() -> None:
    """Its normal equations are zero, and a ridge keeps them solvable."""
    products = torch.zeros(1, 2, 1, 1)
    products[0, 0] = 4.0
    gram = torch.tensor([[[2.0, 0.0], [0.0, 0.0]]])
    zero = torch.zeros(1, 1, 1, dtype=torch.float64)
    over = LeftOver(products, gram, zero + 9.0, zero + 9.0, zero)
    found = over.functions().flatten()
    assert math.isclose(float(found[0]), 2.0, rel_tol=1e-5)
    assert float(found[1]) == 0.0
    assert over.error(over.functions(), None) == pytest.approx(1.0, abs=1e-4)
    empty = LeftOver(torch.zeros_like(products), torch.zeros_like(gram), zero, zero, zero)
    assert not bool(empty.functions().any())
