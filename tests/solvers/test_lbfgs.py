"""Batched L-BFGS and Adam against scipy; rows are independent, and tell how they ended."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
import torch
from scipy.optimize import minimize
from torch import Tensor

from spmm_torch.solvers.adam import minimize_adam
from spmm_torch.solvers.lbfgs import Objective, OptimizeResult, minimize_lbfgs
from spmm_torch.solvers.status import Status

Minimizer = Callable[[Objective, Tensor], OptimizeResult]


def identity(x: Tensor) -> Tensor:
    return x


def ball(x: Tensor) -> Tensor:
    return x / x.norm(dim=-1, keepdim=True).clamp_min(1)


def unit_box(x: Tensor) -> Tensor:
    return x.clamp(0, 1)


def rosenbrock(x: Tensor) -> tuple[Tensor, Tensor]:
    a, b = x[:, 0], x[:, 1]
    curve = b - a**2
    grad = torch.stack([-400 * a * curve - 2 * (1 - a), 200 * curve], dim=1)
    return 100 * curve**2 + (1 - a) ** 2, grad


def make_starts(rows: int, parameters: int, seed: int = 0) -> Tensor:
    generator = torch.Generator().manual_seed(seed)
    return 4 * torch.rand(rows, parameters, generator=generator, dtype=torch.float64) - 2


def make_quadratic(rows: int = 30, parameters: int = 5) -> tuple[Tensor, Tensor, Objective]:
    generator = torch.Generator().manual_seed(1)
    root = torch.randn(rows, parameters, parameters, generator=generator, dtype=torch.float64)
    matrix = root @ root.mT + 0.05 * torch.eye(parameters, dtype=torch.float64)
    linear = torch.randn(rows, parameters, generator=generator, dtype=torch.float64)

    def objective(x: Tensor) -> tuple[Tensor, Tensor]:
        product = (matrix @ x[..., None])[..., 0]
        return (0.5 * x * product - x * linear).sum(1), product - linear

    return matrix, linear, objective


def test_rosenbrock_reaches_the_minimum() -> None:
    found = minimize_lbfgs(rosenbrock, make_starts(50, 2), identity, iterations=200)
    assert (found.status == Status.CONVERGED).all()
    torch.testing.assert_close(found.x, torch.ones(50, 2, dtype=torch.float64), rtol=0, atol=1e-5)


def test_rosenbrock_in_a_box_equals_scipy() -> None:
    starts = make_starts(20, 2)
    found = minimize_lbfgs(rosenbrock, starts, lambda x: x.clamp(-1.5, 0.7), iterations=200)

    def single(z: np.ndarray) -> tuple[float, np.ndarray]:
        value, grad = rosenbrock(torch.from_numpy(z)[None])
        return value.item(), grad[0].numpy()

    bounds = [(-1.5, 0.7)] * 2
    for x, start in zip(found.x, starts.clamp(-1.5, 0.7), strict=True):
        oracle = minimize(single, start.numpy(), jac=True, method="L-BFGS-B", bounds=bounds)
        np.testing.assert_allclose(x.numpy(), oracle.x, atol=1e-4)


def test_box_constrained_quadratics_equal_scipy() -> None:
    matrix, linear, objective = make_quadratic()
    found = minimize_lbfgs(objective, torch.zeros_like(linear), unit_box, iterations=60)
    assert (found.status == Status.CONVERGED).all()
    for x, a, b in zip(found.x, matrix.numpy(), linear.numpy(), strict=True):
        oracle = minimize(
            lambda z, a=a, b=b: (0.5 * z @ a @ z - z @ b, a @ z - b), np.zeros(5), jac=True,
            method="L-BFGS-B", bounds=[(0, 1)] * 5, options={"ftol": 1e-15, "gtol": 1e-9},
        )  # fmt: skip
        np.testing.assert_allclose(x.numpy(), oracle.x, atol=1e-5)


def test_ball_constraint_meets_the_multiplier_rule() -> None:
    _, linear, objective = make_quadratic()
    found = minimize_lbfgs(objective, torch.zeros_like(linear), ball, iterations=200)
    _, grad = objective(found.x)
    norm = found.x.norm(dim=1)
    assert (norm <= 1 + 1e-12).all()
    outside = norm > 1 - 1e-9
    assert outside.any()
    radial = (grad * found.x).sum(1, keepdim=True) * found.x
    assert (grad - radial)[outside].norm(dim=1).max() < 1e-2
    assert (radial * found.x).sum(1)[outside].max() <= 0


def run_lbfgs(objective: Objective, start: Tensor) -> OptimizeResult:
    return minimize_lbfgs(objective, start, unit_box, iterations=40)


def run_adam(objective: Objective, start: Tensor) -> OptimizeResult:
    return minimize_adam(objective, start, unit_box, steps=400, learning_rate=0.02)


MINIMIZERS = pytest.mark.parametrize("minimizer", [run_lbfgs, run_adam])


@MINIMIZERS
def test_batched_equals_looped(minimizer: Minimizer) -> None:
    matrix, linear, objective = make_quadratic(rows=10)
    whole = minimizer(objective, torch.full_like(linear, 0.5))
    for i in range(10):

        def alone(x: Tensor, i: int = i) -> tuple[Tensor, Tensor]:
            grad = (matrix[i] @ x[..., None])[..., 0] - linear[i]
            return (0.5 * x * (grad - linear[i])).sum(1), grad

        single = minimizer(alone, torch.full_like(linear[:1], 0.5))
        torch.testing.assert_close(single.x[0], whole.x[i], rtol=0, atol=1e-6)


@MINIMIZERS
def test_best_value_belongs_to_best_point_and_is_feasible(minimizer: Minimizer) -> None:
    _, linear, objective = make_quadratic()
    start = torch.full_like(linear, 3.0)
    found = minimizer(objective, start)
    assert torch.equal(unit_box(found.x), found.x)
    torch.testing.assert_close(objective(found.x)[0], found.value)
    assert (found.value <= objective(unit_box(start))[0]).all()


@MINIMIZERS
def test_a_row_that_is_not_finite_is_told_and_leaves_the_others_alone(minimizer: Minimizer) -> None:
    _, linear, objective = make_quadratic()
    start = torch.full_like(linear, 0.5)

    def broken(x: Tensor) -> tuple[Tensor, Tensor]:
        value, grad = objective(x)
        value[3], grad[5] = torch.nan, torch.inf
        return value, grad

    clean, found = minimizer(objective, start), minimizer(broken, start)
    bad = found.status == Status.NOT_FINITE
    assert bad.nonzero()[:, 0].tolist() == [3, 5]
    assert torch.equal(found.status[~bad], clean.status[~bad])
    assert torch.equal(found.x[bad], start[bad])
    assert torch.equal(found.x[~bad], clean.x[~bad])


@MINIMIZERS
def test_scale_of_one_row_changes_no_other(minimizer: Minimizer) -> None:
    _, linear, objective = make_quadratic()
    start = torch.full_like(linear, 0.5)

    def scaled(x: Tensor) -> tuple[Tensor, Tensor]:
        value, grad = objective(x)
        value[0] *= 1e6
        grad[0] *= 1e6
        return value, grad

    plain, found = minimizer(objective, start), minimizer(scaled, start)
    assert torch.equal(plain.x[1:], found.x[1:])
    torch.testing.assert_close(plain.x[0], found.x[0], rtol=0, atol=1e-4)


def test_trial_without_a_number_is_shortened() -> None:
    def logarithm(x: Tensor) -> tuple[Tensor, Tensor]:
        return (x - x.log())[:, 0], 1 - 1 / x

    start = torch.tensor([[5.0], [0.01]], dtype=torch.float64)
    found = minimize_lbfgs(logarithm, start, identity, iterations=60, first_step=50.0)
    assert (found.status == Status.CONVERGED).all()
    torch.testing.assert_close(found.x, torch.ones_like(start), rtol=0, atol=1e-5)


def test_no_descent_where_no_step_from_the_start_goes_down() -> None:
    """The gradient of the third row has the wrong sign, so that no step against it is lower."""
    up = torch.tensor([[1.0], [1.0], [-1.0]], dtype=torch.float64)

    def parabola(x: Tensor) -> tuple[Tensor, Tensor]:
        return x.square()[:, 0], 2.0 * x * up

    start = torch.tensor([[3.0], [-2.0], [1.0]], dtype=torch.float64)
    found = minimize_lbfgs(parabola, start, identity, iterations=60)
    assert found.status.tolist() == [Status.CONVERGED, Status.CONVERGED, Status.NO_DESCENT]
    assert float(found.x[2]) == 1.0


def test_converged_where_nothing_goes_down_after_progress() -> None:
    """The gradient of |x| does not vanish at the kink: only the line search can end there."""

    def kink(x: Tensor) -> tuple[Tensor, Tensor]:
        return x.abs()[:, 0], torch.where(x >= 0.0, 1.0, -1.0).to(x)

    start = torch.tensor([[0.15]], dtype=torch.float64)
    found = minimize_lbfgs(kink, start, identity, iterations=400, value_tolerance=0.0)
    assert found.status.tolist() == [Status.CONVERGED]
    assert float(found.value) < 1e-3


def test_limit_where_the_iterations_do_not_suffice() -> None:
    starts = torch.tensor([[-1.5, 1.5], [1.0, 1.0]], dtype=torch.float64)  # the second is optimal
    found = minimize_lbfgs(rosenbrock, starts, identity, iterations=4)
    assert found.status.tolist() == [Status.LIMIT, Status.CONVERGED]
    assert float(found.value[0]) < float(rosenbrock(starts)[0][0])


def test_adam_tends_to_the_constrained_minimum() -> None:
    _, linear, objective = make_quadratic()
    found = minimize_adam(
        objective, torch.zeros_like(linear), unit_box, steps=1500, learning_rate=0.02
    )
    best = minimize_lbfgs(objective, torch.zeros_like(linear), unit_box, iterations=100)
    torch.testing.assert_close(found.value, best.value, rtol=0, atol=1e-5)
    assert (found.status == Status.LIMIT).all()  # Adam has no stopping rule


def test_dtype_follows_the_start() -> None:
    start = make_starts(4, 2).float()
    assert minimize_lbfgs(rosenbrock, start, identity, iterations=5).x.dtype == torch.float32
    found = minimize_adam(rosenbrock, start, identity, steps=5, learning_rate=0.1)
    assert found.x.dtype == torch.float32
