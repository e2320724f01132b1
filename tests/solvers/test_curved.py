"""Descent on errors of compressed values, against SciPy on the same errors."""

from __future__ import annotations

import numpy as np
import torch
from scipy.optimize import least_squares
from torch import Tensor

from spmm_torch.solvers.curved import refine_curved
from spmm_torch.solvers.varpro import VarProResult
from tests.solvers.test_varpro import gaussians, linearized, planted

DARK = 0.05


def refine(
    start: Tensor, weights: Tensor, signals: Tensor, present: Tensor | None = None
) -> VarProResult:
    """Mixtures of least squared error of cube roots."""

    def penalty(values: Tensor, rows: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        error = (values + DARK) ** (1 / 3) - (signals[rows] + DARK) ** (1 / 3)
        slope = (values + DARK) ** (-2 / 3) / 3.0
        return error.square().sum((1, 2), dtype=torch.float64), error * slope, slope.square()

    if present is None:
        present = torch.ones(start.shape[:2], dtype=torch.bool)
    return refine_curved(
        lambda x, rows: linearized(x),
        lambda x, rows: torch.cat((x[..., :1].clamp(-3, 3), x[..., 1:].clamp(0.2, 3)), dim=-1),
        penalty,
        start,
        weights,
        present,
        iterations=100,
    )


def noisy() -> tuple[Tensor, Tensor]:
    """Planted parameters, and signals that no mixture meets."""
    truth, signals = planted(1)
    noise = 0.2 * torch.rand(signals.shape, generator=torch.Generator().manual_seed(2))
    return truth, signals + noise


def test_matches_scipy() -> None:
    truth, signals = noisy()
    result = refine(truth + 0.2, torch.ones(len(truth), 2, 3), signals)

    def residuals(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        rho = gaussians(torch.from_numpy(x[:4]).view(2, 2)).numpy()
        return (np.cbrt(x[4:].reshape(3, 2) @ rho + DARK) - np.cbrt(y + DARK)).ravel()

    low = np.array([-3.0, 0.2, -3.0, 0.2, *[0.0] * 6])
    for sample in range(len(truth)):
        y = signals[sample].double().numpy()
        start = np.concatenate(((truth[sample] + 0.2).double().flatten().numpy(), np.ones(6)))
        best = least_squares(residuals, start, args=(y,), bounds=(low, [3.0] * 4 + [np.inf] * 6))
        assert float(result.loss[sample]) <= 2.0 * best.cost * 1.001


def test_no_weight_is_negative_and_one_that_is_in_the_way_ends_at_zero() -> None:
    truth, _ = planted(3)
    signals = gaussians(truth[:, :1]).expand(-1, 3, -1)  # the second function is not in them
    result = refine(truth + 0.1, torch.ones(len(truth), 2, 3), signals)
    assert (result.weights >= 0.0).all()
    assert float(result.weights[:, 1].max()) < 1e-3
    assert float(result.loss.max()) < 1e-6


def test_padding_has_no_weight_and_no_effect() -> None:
    truth, signals = noisy()
    alone = refine(truth + 0.2, torch.ones(len(truth), 2, 3), signals)
    padded = torch.cat((truth + 0.2, torch.ones(len(truth), 1, 2)), dim=1)
    present = torch.tensor([True, True, False]).expand(len(truth), 3)
    result = refine(padded, torch.ones(len(truth), 3, 3), signals, present)
    assert (result.weights[:, 2] == 0.0).all()
    assert torch.allclose(result.loss, alone.loss, rtol=1e-3)
