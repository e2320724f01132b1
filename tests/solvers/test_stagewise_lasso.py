"""Stagewise Lasso against scikit-learn, its optimality conditions, and how problems end."""

from __future__ import annotations

import pytest
import torch
from sklearn.linear_model import Lasso
from torch import Tensor

from spmm_torch.solvers.stagewise_lasso import StagewiseResult, lasso_threshold, stagewise_lasso
from spmm_torch.solvers.status import Status


def make_problem(
    batch: int = 6, rows: int = 40, atoms: int = 12, seed: int = 0
) -> tuple[Tensor, Tensor]:
    """Positive, strongly correlated unit atoms `[rows, J]` and noisy mixtures `[B, rows]`."""
    generator = torch.Generator().manual_seed(seed)
    design = torch.rand(rows, atoms, generator=generator, dtype=torch.float64)
    design = design / design.norm(dim=0)
    active = torch.rand(batch, atoms, generator=generator) < 0.3
    weights = torch.rand(batch, atoms, generator=generator, dtype=torch.float64) * active
    noise = torch.randn(batch, rows, generator=generator, dtype=torch.float64)
    return design, weights @ design.T + 0.02 * noise


def run(
    design: Tensor, target: Tensor, step: float, lambda_min: Tensor, **options: int
) -> StagewiseResult:
    gram, correlation = design.T @ design, target @ design
    options = {"max_steps": 100_000} | options
    eta = torch.full_like(target[:, 0], step)
    return stagewise_lasso(gram, correlation, eta=eta, lambda_min=lambda_min, **options)


def penalized(design: Tensor, target: Tensor, weights: Tensor, penalty: Tensor) -> Tensor:
    return (target - weights @ design.T).square().sum(1) + penalty * weights.sum(1)


@pytest.mark.parametrize("fraction", [0.5, 0.1, 0.02])
def test_tends_to_scikit_learn(fraction: float) -> None:
    design, target = make_problem()
    penalty = fraction * 2 * (target @ design).amax(1)
    found = run(design, target, 1e-3, penalty).weights
    for y, lam, weights in zip(target, penalty, found, strict=True):
        # scikit-learn minimizes ||y - D x||^2 / (2 n) + alpha sum(x).
        oracle = Lasso(
            alpha=lam.item() / (2 * len(y)), fit_intercept=False, positive=True, tol=1e-12,
            max_iter=100_000,
        ).fit(design.numpy(), y.numpy())  # fmt: skip
        expected = torch.from_numpy(oracle.coef_)
        torch.testing.assert_close(weights, expected, rtol=0, atol=2e-3)
        value = penalized(design, y[None], weights[None], lam)
        best = penalized(design, y[None], expected[None], lam)
        assert best - 1e-9 <= value <= best * (1 + 1e-5)


def test_optimality_conditions_up_to_eta() -> None:
    design, target = make_problem()
    step = 1e-3
    penalty = 0.1 * (target @ design).amax(1)
    found = run(design, target, step, penalty)
    gradient = found.lambda_[:, None] - 2 * (target - found.weights @ design.T) @ design
    slack = 2.1 * step
    assert (gradient >= -slack).all()
    assert (gradient[found.weights > 0] <= slack).all()


def test_lambda_reaches_its_end_and_loss_falls_with_it() -> None:
    design, target = make_problem()
    losses = []
    for fraction in (1.0, 0.5, 0.2, 0.05, 0.0):
        penalty = fraction * (target @ design).amax(1)
        found = run(design, target, 0.01, penalty)
        assert (found.lambda_ >= penalty - 1e-12).all()
        losses.append((target - found.weights @ design.T).square().sum(1))
    assert all((later <= earlier).all() for earlier, later in zip(losses, losses[1:], strict=False))


def test_backward_steps_remove_an_atom_taken_too_early() -> None:
    first, second = torch.eye(3, dtype=torch.float64)[:2]
    between = (first + second + 0.5 * torch.eye(3, dtype=torch.float64)[2]) / 1.5
    design = torch.stack([first, second, between], dim=1)
    target = (first + second)[None]
    found = run(design, target, 0.01, torch.tensor([1e-3], dtype=torch.float64))
    # The third atom correlates best with the target, yet the first two alone explain it.
    assert found.backward_steps.item() > 10
    assert found.steps.item() > found.backward_steps.item()
    early = run(design, target, 0.01, torch.tensor([0.7], dtype=torch.float64))
    assert early.weights[0, 2] > 0.5 and early.backward_steps.item() == 0
    expected = torch.tensor([[1.0, 1.0, 0.0]], dtype=torch.float64)
    torch.testing.assert_close(found.weights, expected, rtol=0, atol=0.05)


def test_batched_equals_looped_and_blocks_change_nothing() -> None:
    design, target = make_problem(batch=40)
    penalty = 0.05 * (target @ design).amax(1)
    whole = run(design, target, 0.01, penalty).weights
    looped = [run(design, target[i, None], 0.01, penalty[i, None]).weights for i in range(40)]
    assert torch.equal(whole, torch.cat(looped))
    assert torch.equal(whole, run(design, target, 0.01, penalty, cpu_block=7 * 12).weights)


def test_own_gram_equals_shared_gram() -> None:
    design, target = make_problem()
    eta = 0.02 * target.norm(dim=1)
    gram = design.T @ design
    problem = {"eta": eta, "lambda_min": eta, "max_steps": 1000}
    shared = stagewise_lasso(gram, target @ design, **problem)
    own = stagewise_lasso(gram.expand(6, 12, 12), target @ design, **problem)
    assert torch.equal(shared.weights, own.weights)


def test_own_gram_follows_its_problem_after_compaction() -> None:
    designs, targets = zip(*(make_problem(batch=1, seed=s) for s in range(12)), strict=True)
    gram = torch.stack([d.T @ d for d in designs])
    correlation = torch.cat([y @ d for d, y in zip(designs, targets, strict=True)])
    eta = torch.logspace(-1, -3, 12, dtype=torch.float64)
    lambda_min = 0.1 * correlation.amax(1)
    problem = {"lambda_min": lambda_min, "max_steps": 10_000}
    whole = stagewise_lasso(gram, correlation, eta=eta, **problem)
    for i in range(12):
        alone = stagewise_lasso(
            gram[i], correlation[i, None], eta=eta[i, None], lambda_min=lambda_min[i, None],
            max_steps=10_000,
        )  # fmt: skip
        assert torch.equal(whole.weights[i], alone.weights[0])


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_dtype_follows_and_weights_are_whole_steps(dtype: torch.dtype) -> None:
    design, target = (v.to(dtype) for v in make_problem())
    eta = 0.02 * target.norm(dim=1)
    found = stagewise_lasso(
        design.T @ design, target @ design, eta=eta, lambda_min=0 * eta, max_steps=2000
    )
    assert found.weights.dtype == found.lambda_.dtype == dtype
    multiple = found.weights / eta[:, None]
    torch.testing.assert_close(multiple, multiple.round(), rtol=0, atol=1e-4)
    assert (multiple.sum(1).round() == found.steps - 2 * found.backward_steps).all()


def test_degenerate_problems() -> None:
    design, target = make_problem(batch=2)
    zero = torch.zeros_like(target)
    nothing = stagewise_lasso(
        design.T @ design, zero @ design, eta=0.02 * zero.norm(dim=1), lambda_min=zero[:, 0],
        max_steps=100,
    )  # fmt: skip
    assert (nothing.weights == 0).all() and (nothing.steps == 0).all()
    assert nothing.lambda_.isfinite().all()
    assert (run(design, -target, 0.01, zero[:, 0]).weights == 0).all()
    single = run(design[:, :1], design[:, 0][None], 0.01, torch.zeros(1, dtype=torch.float64))
    torch.testing.assert_close(single.weights.item(), 1.0, rtol=0, atol=0.011)
    twice = run(design[:, [0, 0]], design[:, 0][None], 0.01, torch.zeros(1, dtype=torch.float64))
    torch.testing.assert_close(twice.weights.sum().item(), 1.0, rtol=0, atol=0.011)
    assert run(design, target, 0.01, zero[:, 0], max_steps=3).steps.tolist() == [3, 3]


def test_threshold_keeps_two_steps_and_drops_one() -> None:
    weights = torch.tensor([[0.0, 0.1, 0.2, 0.3]])
    kept = lasso_threshold(weights, torch.tensor([0.1]))
    assert kept.tolist() == [[0.0, 0.0, weights[0, 2].item(), weights[0, 3].item()]]


def test_paths_end_converged_or_at_the_limit_of_steps() -> None:
    design, target = make_problem()
    none = torch.zeros(6, dtype=torch.float64)
    whole = run(design, target, 0.01, none)
    assert (whole.status == Status.CONVERGED).all()
    middle = int(whole.steps.median())
    cut = run(design, target, 0.01, none, max_steps=middle)
    limit = cut.status == Status.LIMIT
    assert torch.equal(limit, whole.steps >= middle) and limit.any() and not limit.all()
    assert (cut.status[~limit] == Status.CONVERGED).all()
    assert (run(design, 0 * target, 0.01, none).status == Status.CONVERGED).all()
    assert (run(design, target, 0.01, none, max_steps=0).status == Status.LIMIT).all()


def test_paths_that_are_not_finite_are_told_and_leave_the_others_alone() -> None:
    design, target = make_problem()
    gram, correlation = design.T @ design, target @ design
    eta = torch.full((6,), 0.01, dtype=torch.float64)
    none = torch.zeros_like(eta)
    clean = stagewise_lasso(gram, correlation, eta=eta, lambda_min=none, max_steps=1000)
    broken, broken_eta = correlation.clone(), eta.clone()
    broken[1, 3], broken[2, 0] = torch.nan, torch.inf
    broken_eta[3], broken_eta[4] = torch.nan, torch.inf
    found = stagewise_lasso(gram, broken, eta=broken_eta, lambda_min=none, max_steps=1000)
    bad = torch.tensor([False, True, True, True, True, False])
    assert torch.equal(found.status == Status.NOT_FINITE, bad)
    assert torch.equal(found.status[~bad], clean.status[~bad])
    assert torch.equal(found.weights[~bad], clean.weights[~bad])
