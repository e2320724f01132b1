"""Batched projected L-BFGS: every row is a problem of its own.

`torch.optim.LBFGS` flattens all rows into one vector with one history and one line search. Here
each row has its own history, step length and end, so rows do not affect each other. One call of the
objective serves all rows: one row may take a new direction while another shortens its step.

References:
    [NW06] Jorge Nocedal, Stephen J. Wright, Numerical Optimization, 2nd edition, Springer, 2006,
        algorithm 7.4 (two-loop recursion) and §3.1 (backtracking).
    [Ber82] Dimitri P. Bertsekas, Projected Newton Methods for Optimization Problems with Simple
        Constraints, SIAM Journal on Control and Optimization 20(2), 1982: coordinates held by a
        bound keep out of the metric.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import torch
from torch import Tensor

from .status import worst_status

# Maps points `[R, P]` to values `[R]` and gradients `[R, P]`, row by row.
Objective = Callable[[Tensor], tuple[Tensor, Tensor]]
# Maps points `[R, P]` to the nearest feasible ones, row by row.
Projection = Callable[[Tensor], Tensor]

# Armijo's sufficient decrease [NW06 §3.1].
SUFFICIENT_DECREASE = 1e-4
# Bounds of a shortened step relative to the last one [NW06 §3.5].
SHORTEST, LONGEST = 0.1, 0.5
# Least curvature of a pair relative to |s| |y|: less would spoil the metric.
LEAST_CURVATURE = 1e-8
# Length of the probe step that finds the directions that the constraints leave free.
PROBE_LENGTH = 1e-4
# Relative change of the value that counts as rounding, in units of the dtype's epsilon.
ROUNDING_UNITS = 10.0
# Evaluations between two checks for the end of all rows; each check waits for the device.
EVALUATIONS_PER_CHECK = 4


@dataclass(frozen=True)
class OptimizeResult:
    """Best point seen of each row, and how the row ended.

    Attributes:
        x: `[R, P]`.
        value: `[R]`.
        status: `[R]` int8.
    """

    x: Tensor
    value: Tensor
    status: Tensor


@dataclass
class _State:
    """Accepted point and trial step of each row."""

    x: Tensor  # [R, P]
    value: Tensor  # [R]
    grad: Tensor  # [R, P]
    direction: Tensor  # [R, P]
    length: Tensor  # [R]
    backtracks: Tensor  # [R] long
    steps: Tensor  # [R, M, P], x differences, newest first, zero where unused
    changes: Tensor  # [R, M, P], gradient differences
    converged: Tensor  # [R] bool
    failed: Tensor  # [R] bool, NaN or infinity where a number is needed
    stalled: Tensor  # [R] bool, no decrease along the steepest descent either


def minimize_lbfgs(
    objective: Objective,
    start: Tensor,
    project: Projection,
    *,
    iterations: int,
    history: int = 8,
    backtracks: int = 12,
    first_step: float = 0.1,
    gradient_tolerance: float = 1e-6,
    value_tolerance: float | None = None,
) -> OptimizeResult:
    """Minimizes R independent functions over a convex set, each row on its own.

    A trial that is NaN or infinite is shortened. A row whose start or whose trials are all NaN or
    infinite stays at its best point and ends NOT_FINITE. A row whose first line search finds no
    lower value ends NO_DESCENT. If a later one finds none, the rest is rounding and the row has
    CONVERGED.

    Args:
        objective: maps `[R, P]` to values `[R]` and gradients `[R, P]`; row r depends on row r of
            its input only.
        start: `[R, P]`; projected first.
        project: projection on the feasible set, row by row, for instance a box.
        iterations: calls of the objective after the first.
        history: curvature pairs kept, M.
        backtracks: most shortenings of one step before the history is dropped.
        first_step: length of the first trial step, in units of x.
        gradient_tolerance: a row has converged when the largest entry of its projected gradient
            is under this times max(1, |value|).
        value_tolerance: or when a step lowers the value by less than this relative to |value|;
            default ten times the epsilon of the dtype.

    Returns:
        Best point, value and status of each row.
    """
    if value_tolerance is None:
        value_tolerance = ROUNDING_UNITS * torch.finfo(start.dtype).eps
    state = _begin(objective, project(start), history)
    first = state.value.clone()
    _new_direction(state, project, torch.ones_like(state.failed), first_step, gradient_tolerance)
    for evaluation in range(iterations):
        running = ~(state.converged | state.failed | state.stalled)
        if evaluation % EVALUATIONS_PER_CHECK == 0 and not bool(running.any()):
            break
        trial = project(state.x + state.length[:, None] * state.direction)
        trial = torch.where(running[:, None], trial, state.x)
        value, grad = objective(trial)
        accepted = _accept(state, trial, value, grad, running, value_tolerance)
        exhausted = _shorten(state, trial, value, running & ~accepted, backtracks)
        renewed = accepted | exhausted
        _new_direction(state, project, renewed, first_step, gradient_tolerance)
    stuck = state.stalled & (state.value == first)
    status = worst_status(state.converged | state.stalled, stuck, state.failed)
    return OptimizeResult(state.x, state.value, status)


def _begin(objective: Objective, x: Tensor, history: int) -> _State:
    value, grad = objective(x)
    rows, parameters = x.shape
    failed = ~(value.isfinite() & grad.isfinite().all(-1))
    none = torch.zeros_like(failed)
    return _State(
        x=x.clone(),
        value=value.clone(),
        grad=torch.where(failed[:, None], 0.0, grad),
        direction=torch.zeros_like(x),
        length=torch.zeros_like(value),
        backtracks=torch.zeros(rows, dtype=torch.long, device=x.device),
        steps=x.new_zeros(rows, history, parameters),
        changes=x.new_zeros(rows, history, parameters),
        converged=none.clone(),
        failed=failed,
        stalled=none.clone(),
    )


def _accept(
    state: _State,
    trial: Tensor,
    value: Tensor,
    grad: Tensor,
    running: Tensor,
    value_tolerance: float,
) -> Tensor:
    """Accepts trials of sufficient decrease and their curvature pairs, in place; `[R]` bool."""
    finite = value.isfinite() & grad.isfinite().all(-1)
    step = trial - state.x  # [R, P]
    expected = (state.grad * step).sum(-1)  # [R], negative along a descent
    enough = value <= state.value + SUFFICIENT_DECREASE * expected.clamp_max(0)
    accepted = running & finite & enough & (expected < 0)
    change = torch.where(accepted[:, None], grad - state.grad, 0.0)
    curvature = (step * change).sum(-1)
    useful = curvature > LEAST_CURVATURE * step.norm(dim=-1) * change.norm(dim=-1)
    useful = (accepted & useful)[:, None, None]
    pushed = torch.cat([step[:, None], state.steps[:, :-1]], dim=1)
    state.steps = torch.where(useful, pushed, state.steps)
    pushed = torch.cat([change[:, None], state.changes[:, :-1]], dim=1)
    state.changes = torch.where(useful, pushed, state.changes)
    gain = state.value - value
    state.converged |= accepted & (gain <= value_tolerance * state.value.abs())
    state.x = torch.where(accepted[:, None], trial, state.x)
    state.value = torch.where(accepted, value, state.value)
    state.grad = torch.where(accepted[:, None], grad, state.grad)
    return accepted


def _shorten(
    state: _State, trial: Tensor, value: Tensor, rejected: Tensor, backtracks: int
) -> Tensor:
    """Shortens rejected steps, in place, by a parabola through value, derivative and trial value.

    Returns True `[R]` for rows that have used up their shortenings. Their history is dropped. A row
    without history has tried the steepest descent: it ends, as failed if its last trial was NaN or
    infinite.
    """
    expected = (state.grad * (trial - state.x)).sum(-1)  # [R]
    excess = value - state.value - expected
    factor = (-0.5 * expected / excess).clamp(SHORTEST, LONGEST)
    factor = torch.where(factor.isfinite(), factor, SHORTEST)
    state.length = torch.where(rejected, state.length * factor, state.length)
    state.backtracks = torch.where(rejected, state.backtracks + 1, state.backtracks)
    exhausted = rejected & (state.backtracks > backtracks)
    fresh = (state.steps == 0).all(dim=(1, 2))
    state.failed |= exhausted & fresh & ~value.isfinite()
    state.stalled |= exhausted & fresh
    state.steps = torch.where(exhausted[:, None, None], 0.0, state.steps)
    state.changes = torch.where(exhausted[:, None, None], 0.0, state.changes)
    return exhausted


def _new_direction(
    state: _State, project: Projection, renewed: Tensor, first_step: float, tolerance: float
) -> None:
    """Sets direction and first step of the renewed rows, in place; ends rows at an optimum."""
    descent = _feasible(state.x, -state.grad, project)  # [R, P], projected gradient
    largest = descent.abs().amax(-1)  # [R]
    state.converged |= renewed & (largest <= tolerance * state.value.abs().clamp_min(1))
    # A bound holds each coordinate whose gradient the projection removes [Ber82].
    free = ((descent != 0) | (state.grad == 0)).to(descent.dtype)  # [R, P]
    newton = free * _two_loop(state.steps * free[:, None], state.changes * free[:, None], descent)
    newton = _feasible(state.x, newton, project)
    downhill = (newton * state.grad).sum(-1) < 0  # [R], False for NaN
    has_history = (state.steps != 0).any(-1).any(-1)
    use_newton = (downhill & has_history)[:, None]
    direction = torch.where(use_newton, newton, descent)
    tiny = torch.finfo(direction.dtype).tiny
    short = first_step / direction.norm(dim=-1).clamp_min(tiny)
    length = torch.where(use_newton[:, 0], 1.0, short)
    state.direction = torch.where(renewed[:, None], direction, state.direction)
    state.length = torch.where(renewed, length, state.length)
    state.backtracks = torch.where(renewed, 0, state.backtracks)


def _feasible(x: Tensor, direction: Tensor, project: Projection) -> Tensor:
    """Projection of a direction `[R, P]` on the tangent cone of the constraints."""
    tiny = torch.finfo(x.dtype).tiny
    scale = PROBE_LENGTH / direction.norm(dim=-1, keepdim=True).clamp_min(tiny)  # [R, 1]
    probe = x + scale * direction
    projected = project(probe)
    # Where the projection changes nothing, the direction itself is free of cancellation.
    return torch.where(projected == probe, direction, (projected - x) / scale)


def _two_loop(steps: Tensor, changes: Tensor, descent: Tensor) -> Tensor:
    """Inverse-Hessian product H d `[R, P]` from the pairs `[R, M, P]` [NW06 algorithm 7.4].

    Pairs without positive curvature, and unused ones, drop out of the recursion.
    """
    curvature = torch.einsum("rmp,rmp->rm", steps, changes)  # [R, M]
    usable = curvature > 0
    rho = torch.where(usable, 1 / curvature, 0.0)  # [R, M]
    pairs = range(steps.shape[1])
    vector, alphas = descent, []
    for m in pairs:
        alpha = rho[:, m] * (steps[:, m] * vector).sum(-1)  # [R]
        alphas.append(alpha)
        vector = vector - alpha[:, None] * changes[:, m]
    # Scale by the newest usable pair.
    newest = usable.to(torch.uint8).argmax(-1, keepdim=True)  # [R, 1]
    square = changes.square().sum(-1).gather(1, newest)  # [R, 1]
    gamma = torch.where(square > 0, curvature.gather(1, newest) / square, 1.0)
    vector = vector * torch.where(usable.any(-1, keepdim=True), gamma, 1.0)
    for m in reversed(pairs):
        beta = rho[:, m] * (changes[:, m] * vector).sum(-1)
        vector = vector + (alphas[m] - beta)[:, None] * steps[:, m]
    return vector
