"""Every warp against its density."""

from __future__ import annotations

from collections.abc import Callable

import pytest
import torch
from torch import Tensor

from spmm_torch.geometry import warp
from tests.chi2 import Grid, check, pooled_statistic

WARPS: list[tuple[str, tuple[float, ...]]] = [
    ("square_to_cosine_hemisphere", ()),
    ("square_to_uniform_hemisphere", ()),
    ("square_to_power_cosine", (0.1,)),
    ("square_to_power_cosine", (800.0,)),
    ("square_to_beckmann", (0.8, 0.3)),
    ("square_to_beckmann", (0.02, 0.05)),
    ("square_to_ashikhmin_shirley", (0.2, 9.0)),
    ("square_to_ashikhmin_shirley", (2000.0, 300.0)),
]
Warp = tuple[Callable[[Tensor], Tensor], Callable[[Tensor], Tensor]]


def functions(name: str, parameters: tuple[float, ...], dtype: torch.dtype = torch.float64) -> Warp:
    """(warp of u `[N, 3]`, density) at fixed parameters."""
    fixed = [torch.tensor(value, dtype=dtype) for value in parameters]
    forward, density = getattr(warp, name), getattr(warp, name + "_pdf")
    return lambda u: forward(u[:, :2], *fixed), lambda w: density(w, *fixed)


@pytest.mark.parametrize(("name", "parameters"), WARPS)
def test_chi_square(name: str, parameters: tuple[float, ...]) -> None:
    outcome = check(*functions(name, parameters), 100_000, 20, 40, seed=len(name) + 17)
    assert outcome.accepted, outcome


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64], ids=str)
@pytest.mark.parametrize(("name", "parameters"), WARPS)
def test_edges_of_the_square(name: str, parameters: tuple[float, ...], dtype: torch.dtype) -> None:
    forward, density = functions(name, parameters, dtype)
    edge = torch.tensor([0.0, 1e-8, 0.25, 0.5, 1.0 - torch.finfo(dtype).eps / 2.0], dtype=dtype)
    w = forward(torch.cartesian_prod(edge, edge))
    assert w.dtype == density(w).dtype == dtype
    torch.testing.assert_close(w.norm(dim=1), torch.ones(25, dtype=dtype))
    assert bool((w[:, 2] >= 0.0).all())
    assert bool((density(w).isfinite() & (density(w) >= 0.0)).all())


@pytest.mark.parametrize(("name", "parameters"), WARPS)
def test_nothing_under_the_horizon(name: str, parameters: tuple[float, ...]) -> None:
    below = torch.tensor([[0.6, 0.0, -0.8], [0.0, 0.0, -1.0]], dtype=torch.float64)
    assert torch.equal(functions(name, parameters)[1](below), torch.zeros(2, dtype=torch.float64))


@pytest.mark.parametrize(
    ("drawn", "claimed"),
    [
        (("square_to_cosine_hemisphere", ()), ("square_to_uniform_hemisphere", ())),
        (("square_to_beckmann", (0.10, 0.10)), ("square_to_beckmann", (0.104, 0.10))),
        (("square_to_power_cosine", (20.0,)), ("square_to_power_cosine", (22.0,))),
    ],
)
def test_the_test_finds_wrong_densities(
    drawn: tuple[str, tuple[float, ...]], claimed: tuple[str, tuple[float, ...]]
) -> None:
    """A width wrong by four percent is enough, or an exponent by ten."""
    outcome = check(functions(*drawn)[0], functions(*claimed)[1], 100_000, 20, 40)
    assert outcome.p_value < 1e-9


def test_cells_that_expect_too_little_are_pooled() -> None:
    expected = torch.tensor([100.0, 1.0, 1.0, 1.0, 2.0, 0.0, 50.0], dtype=torch.float64)
    observed = torch.tensor([110.0, 3.0, 0.0, 2.0, 0.0, 1.0, 40.0], dtype=torch.float64)
    statistic, cells = pooled_statistic(observed, expected)
    assert cells == 3
    assert statistic == pytest.approx((6.0 - 5.0) ** 2 / 5.0 + 2.0 + 1.0)
    expected = torch.tensor([100.0, 1.0, 1.0, 0.0, 0.0, 0.0, 50.0], dtype=torch.float64)
    statistic, cells = pooled_statistic(observed, expected)
    assert cells == 2
    assert statistic == pytest.approx((46.0 - 52.0) ** 2 / 52.0 + 1.0)


def test_quadrature_finds_a_lobe_between_its_nodes() -> None:
    forward, density = functions("square_to_beckmann", (0.01, 0.01))
    even = torch.rand(1000, 3, generator=torch.Generator().manual_seed(1), dtype=torch.float64)
    grid = Grid.around(functions("square_to_uniform_hemisphere", ())[0](even), 20, 40)
    observed = grid.counts(forward(torch.rand(10_000, 3, dtype=torch.float64))).double()
    assert float(grid.integrate(density, 10_000, observed).sum()) == pytest.approx(1.0, abs=1e-3)
