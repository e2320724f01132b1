"""Dictionary space against the same sums written out over all pairs."""

from __future__ import annotations

import pytest
import torch
from torch import Tensor

from spmm_torch.config.fit import SelectConfig, StagewiseConfig
from spmm_torch.fit.select.products import Products, cluster_products
from spmm_torch.fit.select.target import (
    residual_weight,
    taken_by_residual,
    target_beside_residual,
)
from spmm_torch.fit.select.texels import Fit, refit, select, squared_errors

TEXELS, ATOMS, PAIRS, CHANNELS = 12, 7, 60, 3


def case(seed: int = 0) -> tuple[Tensor, Tensor, Products]:
    generator = torch.Generator().manual_seed(seed)
    atoms = torch.rand(ATOMS, PAIRS, generator=generator)
    atoms = atoms / atoms.norm(dim=1, keepdim=True)
    values = torch.rand(TEXELS, PAIRS, CHANNELS, generator=generator)
    parts = [slice(0, 5), slice(5, TEXELS)]
    products = cluster_products(
        lambda p: values.transpose(1, 2)[p],
        parts,
        (TEXELS, CHANNELS),
        atoms,
        points=values.flatten(1),
    )
    return atoms, values, products


def mean_weights(fit: Fit) -> Tensor:
    """The mean weight of every atom, `[J, C]`."""
    return fit.total_weights(ATOMS) / TEXELS


def errors(products: Products, fit: Fit) -> tuple[Tensor, float]:
    """(without residual, of each texel; what the residual takes away from their sum)."""
    return squared_errors(products, fit), taken_by_residual(products, mean_weights(fit))


def chosen(products: Products, method: str = "corrective", **settings: object) -> Fit:
    config = SelectConfig(method=method, **settings)
    return select(products, target_beside_residual(products, None, 0.0), config, StagewiseConfig())


def expand(fit: Fit, atoms: Tensor) -> Tensor:
    """D x of every texel, `[n, D, C]`."""
    used = atoms[fit.index.clamp(min=0)] * (fit.index >= 0)[..., None]
    return torch.einsum("nmd,nmc->ndc", used, fit.weights)


@pytest.mark.parametrize("method", ["corrective", "stagewise"])
def test_errors_equal_the_direct_sums(method: str) -> None:
    atoms, values, products = case()
    fit = chosen(products, method)
    left = values - expand(fit, atoms)
    error, taken = errors(products, fit)
    assert torch.allclose(error.float(), left.square().sum((1, 2)), rtol=1e-4)
    with_residual = (left - left.mean(0)).square().sum()
    assert float(error.sum() - taken) == pytest.approx(float(with_residual), rel=1e-3)


@pytest.mark.parametrize("weight", [0.0, 0.4, 1.0])
def test_target_equals_values_minus_residual(weight: float) -> None:
    atoms, values, products = case(1)
    fit = chosen(products)
    residual = (values - expand(fit, atoms)).mean(0)
    direct = values - weight * residual
    target = target_beside_residual(products, mean_weights(fit), weight)
    expected = torch.einsum("jd,ndc->njc", atoms, direct)
    assert torch.allclose(target.correlation, expected, atol=1e-4)
    assert torch.allclose(target.energy.sum(1).float(), direct.square().sum((1, 2)), rtol=1e-3)


def test_alternation_around_the_mean_never_leaves_more_than_the_mean() -> None:
    _, _, products = case(2)
    target = target_beside_residual(products, None, 1.0)
    fit = select(products, target, SelectConfig(), StagewiseConfig())
    of_mean = float(products.energy.sum() - TEXELS * products.mean_energy.sum())
    last = of_mean
    for _ in range(4):
        error, taken = errors(products, fit)
        now = float(error.sum() - taken)
        assert now <= last * (1.0 + 1e-5)
        last = now
        fit = refit(products, fit, target_beside_residual(products, mean_weights(fit), 1.0))


@pytest.mark.parametrize("method", ["corrective", "stagewise"])
def test_lobe_limit_holds_and_weights_are_not_negative(method: str) -> None:
    _, _, products = case(3)
    fit = chosen(products, method, max_lobes=2)
    assert int((fit.index >= 0).sum(1).max()) <= 2
    assert (fit.weights >= 0.0).all()


def test_weight_of_the_residual_follows_the_errors() -> None:
    assert residual_weight(1.0, 0.0, 1000) == pytest.approx(0.5, abs=1e-3)
    assert residual_weight(1.0, 0.99, 1000) > 0.98
    assert residual_weight(1.0, 1.0, 1) == 0.0
    assert residual_weight(0.0, 0.0, 10) == 0.0
