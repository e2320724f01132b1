"""Variable projection on sums of Gaussians, whose true parameters are known."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from scipy.optimize import least_squares, nnls
from torch import Tensor

from spmm_torch.solvers.status import Status
from spmm_torch.solvers.varpro import VarProResult, refine_mixtures

GRID = torch.linspace(-3.0, 3.0, 200)


def gaussians(x: Tensor) -> Tensor:
    """exp(-(t - centre)^2 / width^2) of `x [..., 2]`: `[..., 200]`."""
    return torch.exp(-(((GRID.to(x) - x[..., :1]) / x[..., 1:]) ** 2))


def linearized(x: Tensor) -> Tensor:
    """Values and derivatives `[s, M, 1 + P, D]`."""
    rho, derivative = jacobian(x)
    return torch.cat((rho[..., None, :], derivative), dim=-2)


def jacobian(x: Tensor) -> tuple[Tensor, Tensor]:
    rho = gaussians(x)
    offset = GRID.to(x) - x[..., :1]
    by_centre = rho * 2.0 * offset / x[..., 1:] ** 2
    by_width = rho * 2.0 * offset**2 / x[..., 1:] ** 3
    return rho, torch.stack((by_centre, by_width), dim=-2)


def refine(
    start: Tensor,
    signals: Tensor,
    present: Tensor | None = None,
    iterations: int = 60,
    tolerance: float = 0.0,
) -> VarProResult:
    if present is None:
        present = torch.ones(start.shape[:2], dtype=torch.bool)
    return refine_mixtures(
        lambda x, rows: gaussians(x),
        lambda x, rows: linearized(x),
        lambda x, rows: torch.cat((x[..., :1].clamp(-3, 3), x[..., 1:].clamp(0.2, 3)), dim=-1),
        start,
        present,
        signals,
        iterations=iterations,
        tolerance=tolerance,
    )


def planted(seed: int, samples: int = 6) -> tuple[Tensor, Tensor]:
    generator = torch.Generator().manual_seed(seed)
    centre = torch.tensor([-1.2, 1.0]) + 0.3 * torch.rand(samples, 2, generator=generator)
    width = 0.6 + 0.4 * torch.rand(samples, 2, generator=generator)
    truth = torch.stack((centre, width), dim=-1)
    weights = 0.2 + torch.rand(samples, 3, 2, generator=generator)
    return truth, weights @ gaussians(truth)


def test_finds_planted_parameters() -> None:
    truth, signals = planted(0)
    result = refine(truth + 0.2, signals)
    assert torch.allclose(result.coordinates, truth, atol=1e-3)
    assert (result.loss < 1e-6 * signals.square().sum((1, 2))).all()
    assert (result.status == Status.CONVERGED).all()


def test_matches_scipy_on_noisy_signals() -> None:
    truth, signals = planted(1)
    noise = torch.Generator().manual_seed(2)
    signals = signals + 0.1 * torch.randn(signals.shape, generator=noise)
    result = refine(truth + 0.2, signals)

    def residuals(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        rho = gaussians(torch.from_numpy(x).view(2, 2)).numpy()
        return np.concatenate([nnls(rho.T, row)[0] @ rho - row for row in y])

    for sample in range(len(truth)):
        y = signals[sample].double().numpy()
        best = least_squares(residuals, (truth[sample] + 0.2).double().flatten().numpy(), args=(y,))
        assert float(result.loss[sample]) <= 2.0 * best.cost * 1.001


def test_batched_equals_looped() -> None:
    truth, signals = planted(3)
    whole = refine(truth + 0.2, signals, iterations=5)
    for sample in range(len(truth)):
        alone = refine(truth[sample : sample + 1] + 0.2, signals[sample : sample + 1], iterations=5)
        assert torch.allclose(alone.coordinates[0], whole.coordinates[sample], atol=1e-4)


def test_never_worse_than_its_start() -> None:
    truth, signals = planted(4)
    start = truth + torch.tensor([1.5, 0.8])
    before = refine(start, signals, iterations=0).loss
    assert (refine(start, signals, iterations=3).loss <= before).all()


def test_padding_has_no_weight_and_no_effect() -> None:
    truth, signals = planted(5)
    padded = torch.cat((truth + 0.2, torch.ones(len(truth), 1, 2)), dim=1)
    present = torch.tensor([True, True, False]).expand(len(truth), 3)
    result = refine(padded, signals, present)
    assert (result.weights[:, 2] == 0.0).all()
    assert torch.allclose(result.coordinates[:, :2], truth, atol=1e-3)


@pytest.mark.parametrize("scale", [1e-6, 1e6])
def test_scale_of_the_signal_does_not_matter(scale: float) -> None:
    truth, signals = planted(6)
    result = refine(truth + 0.2, signals * scale)
    assert torch.allclose(result.coordinates, truth, atol=1e-2)


def not_finite(count: int, row: int) -> list[bool]:
    return [other == row for other in range(count)]


def test_limit_where_the_iterations_do_not_suffice() -> None:
    truth, signals = planted(0)
    assert (refine(truth + 0.2, signals, iterations=1).status == Status.LIMIT).all()
    loose = refine(truth + 0.2, signals, iterations=1, tolerance=1.0)
    assert (loose.status == Status.CONVERGED).all()


def test_a_signal_that_is_not_finite_is_told_and_leaves_the_others_alone() -> None:
    truth, signals = planted(7)
    broken = signals.clone()
    broken[2] = torch.nan
    result = refine(truth + 0.2, broken)
    assert (result.status == Status.NOT_FINITE).tolist() == not_finite(len(truth), 2)
    assert torch.allclose(result.coordinates[0], truth[0], atol=1e-3)


def test_a_jacobian_that_is_not_finite_is_told_and_the_start_stays() -> None:
    truth, signals = planted(8)

    def broken(x: Tensor) -> Tensor:
        found = linearized(x)
        found[2, :, 1:] = torch.nan
        return found

    result = refine_mixtures(
        lambda x, rows: gaussians(x),
        lambda x, rows: broken(x),
        lambda x, rows: x,
        truth + 0.2,
        torch.ones(truth.shape[:2], dtype=torch.bool),
        signals,
        iterations=1,
    )
    assert (result.status == Status.NOT_FINITE).tolist() == not_finite(len(truth), 2)
    assert torch.equal(result.coordinates[2], truth[2] + 0.2)


def test_no_descent_where_no_step_from_the_start_goes_down() -> None:
    truth, signals = planted(9)
    ascent = refine_mixtures(
        lambda x, rows: gaussians(x),
        lambda x, rows: linearized(x) * torch.tensor([1.0, -1.0, -1.0])[:, None],
        lambda x, rows: x,
        truth + 0.2,
        torch.ones(truth.shape[:2], dtype=torch.bool),
        signals,
        iterations=60,
    )
    assert (ascent.status == Status.NO_DESCENT).all()
    assert torch.equal(ascent.coordinates, truth + 0.2)
