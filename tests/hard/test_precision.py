"""float16 input, float32 against float64, and what TF32 and bfloat16 must not reach."""

from __future__ import annotations

import pytest
import torch
from torch import Tensor

from spmm_torch import FitConfig, load_btf
from spmm_torch.config.fit import SelectConfig, StagewiseConfig
from spmm_torch.data import sample_path
from spmm_torch.fit import fit
from spmm_torch.fit.search.bank import Bank, build_bank
from spmm_torch.fit.search.joint import CorrectiveSearch
from spmm_torch.fit.search.mixtures import Mixtures
from spmm_torch.fit.select.products import Products, cluster_products
from spmm_torch.fit.select.target import target_beside_residual
from spmm_torch.fit.select.texels import Fit, select, squared_errors
from spmm_torch.lobes.batch import Feasible, LobeBatch
from spmm_torch.lobes.grid import DirectionGrid
from tests.hard.cases import COARSE, GLOSS, QUICK, noisy, planted_texture

CONFIG = FitConfig.from_dict(QUICK)
MODELS = ("lambertian", "ward", "blinn_phong", "lafortune")
TEXELS = 60


def decibels(a: Tensor, b: Tensor) -> Tensor:
    """How far apart two errors are."""
    return 10.0 * (a / b).log10().abs()


@pytest.fixture(scope="module")
def weave() -> tuple[Tensor, Tensor]:
    """Values `[T, D, C]` of texels of the sample, and atoms `[J, D]` of unit norm."""
    btf = load_btf(sample_path())
    third = torch.arange(0, 81, 3)
    btf = btf.restricted(torch.arange(TEXELS) * 26, (1, TEXELS), views=third, lights=third)
    grid = DirectionGrid.build(btf.light, btf.view, torch.device("cpu"))
    bank = build_bank(grid, MODELS, 12, Feasible.build(0.05))
    return btf.texels(), bank.atoms[::3]


def selected(values: Tensor, atoms: Tensor) -> tuple[Products, Fit]:
    """Up to 8 lobes of every texel, in the precision of the atoms."""
    values = values.to(atoms.dtype)
    mean = values.mean(0)
    products = Products(
        gram=atoms @ atoms.T,
        correlation=torch.einsum("jd,tdc->tjc", atoms, values),
        energy=values.double().square().sum(1),
        mean=mean,
        mean_correlation=atoms @ mean,
        mean_energy=mean.double().square().sum(0),
        count=len(values),
        effective=len(values),
    )
    target = target_beside_residual(products, None, 0.0)
    return products, select(products, target, SelectConfig(max_lobes=8), StagewiseConfig())


def test_selection_in_float32_is_that_in_float64(weave: tuple[Tensor, Tensor]) -> None:
    values, atoms = weave
    single, double = selected(values, atoms), selected(values, atoms.double())
    pairs = zip(single[1].index.tolist(), double[1].index.tolist(), strict=True)
    assert all(set(a) - {-1} == set(b) - {-1} for a, b in pairs)
    assert (decibels(squared_errors(*single), squared_errors(*double)) < 0.05).all()


def test_products_in_float32_are_those_in_float64(weave: tuple[Tensor, Tensor]) -> None:
    values, atoms = weave
    whole = [slice(0, TEXELS)]
    products = cluster_products(
        lambda part: values.transpose(1, 2)[part], whole, (TEXELS, 3), atoms
    )
    exact, fit = selected(values, atoms.double())
    assert (decibels(squared_errors(products, fit), squared_errors(exact, fit)) < 0.05).all()


def searched(dtype: torch.dtype) -> Mixtures:
    """What the search finds on noisy texels in some precision."""
    directions = COARSE.to(dtype)
    grid = DirectionGrid.build(directions, directions, torch.device("cpu"))
    feasible = Feasible.build(0.05)
    device = torch.device("cpu")
    bank = build_bank(DirectionGrid.build(COARSE, COARSE, device), MODELS, 24, feasible)
    parts = (part.to(dtype) for part in (bank.lobes.kappa, bank.lobes.normal, bank.lobes.angle))
    lobes = LobeBatch(bank.lobes.model, *parts)
    bank = Bank(lobes, bank.coordinates.to(dtype), bank.atoms.to(dtype))
    signals = noisy(0.05).texels()[:3].transpose(1, 2).to(dtype)
    none = bank.lobes[:0]
    return CorrectiveSearch(grid, bank, feasible, CONFIG.search, signals, none).run(lambda _: None)


def test_search_in_float32_is_that_in_float64() -> None:
    single, double = searched(torch.float32), searched(torch.float64)
    assert double.coordinates.dtype == torch.float64
    assert torch.equal(single.present, double.present)
    used = single.present
    assert torch.equal(single.model[used], double.model[used])
    assert (decibels(single.loss, double.loss) < 0.05).all()


def test_float16_input_costs_no_more_than_its_rounding() -> None:
    single = fit(noisy(0.05), CONFIG).report
    half = fit(noisy(0.05, dtype=torch.float16), CONFIG).report
    assert half["raw_bytes"] == single["raw_bytes"] // 2
    for name in ("without_residual", "with_residual", "cluster_mean"):
        assert half["snr_db"][name] > single["snr_db"][name] - 0.05


def test_nothing_that_a_process_asks_for_coarsens_a_fit() -> None:
    """TF32 and bfloat16, by either of torch's ways, leave every byte as it was."""
    btf = planted_texture([GLOSS] * 2, COARSE, "gloss")
    expected = fit(btf, CONFIG).model.pack()
    try:
        torch.set_float32_matmul_precision("medium")
        with torch.autocast("cpu", dtype=torch.bfloat16):
            found = fit(btf, CONFIG).model.pack()
    finally:
        torch.set_float32_matmul_precision("highest")
    assert found == expected
