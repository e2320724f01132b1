"""Variable projection: all parameters of small non-negative mixtures refined together, in a batch.

Minimizes over x the function min_{w >= 0} sum_c ||y_c - sum_m w_cm rho_m(x_m)||^2 of S independent
signals [GP73] by Levenberg-Marquardt [Mar63] with Kaufman's approximation of the Jacobian [Kau75].
The weights are solved inside, so only the parameters of the basis functions are searched.

References:
    [GP73] Gene H. Golub, Victor Pereyra, The Differentiation of Pseudo-Inverses and Nonlinear Least
        Squares Problems Whose Variables Separate, SIAM Journal on Numerical Analysis 10(2), 1973.
    [Kau75] Linda Kaufman, A Variable Projection Method for Solving Separable Nonlinear Least
        Squares Problems, BIT Numerical Mathematics 15, 1975.
    [Mar63] Donald W. Marquardt, An Algorithm for Least-Squares Estimation of Nonlinear Parameters,
        Journal of the Society for Industrial and Applied Mathematics 11(2), 1963.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import torch
from torch import Tensor

from .nnls import nnls_shared_gram
from .status import worst_status

# Damping of Marquardt: start, bounds, and factors after a good and a bad step.
DAMPING_START, DAMPING_MIN, DAMPING_MAX = 1e-2, 1e-7, 1e7
DAMPING_DOWN, DAMPING_UP = 1.0 / 3.0, 4.0
# Ridge relative to the mean of a diagonal: a parameter without effect must not make it singular.
RELATIVE_RIDGE = 1e-7

# Both take coordinates `[s, M, P]` and the indices `[s]` of their signals.
ValueFunction = Callable[[Tensor, Tensor], Tensor]
JacobianFunction = Callable[[Tensor, Tensor], tuple[Tensor, Tensor]]


@dataclass(frozen=True)
class VarProResult:
    """The refined mixtures.

    Attributes:
        coordinates: `[S, M, P]`.
        weights: non-negative, `[S, M, C]`.
        loss: remaining squared error `[S]` float64.
        status: `[S]` int8. CONVERGED: a step gained too little, or after progress no step lowers
            the loss any more. LIMIT: of iterations. NO_DESCENT: no step, however short, lowers the
            loss of the start. NOT_FINITE: a loss at the start or a gradient was NaN or infinite;
            the best point before that is returned.
    """

    coordinates: Tensor
    weights: Tensor
    loss: Tensor
    status: Tensor


@dataclass(frozen=True)
class _Fit:
    """The weights of S mixtures and their losses, in float64."""

    weights: Tensor  # [S, C, M]
    loss: Tensor  # [S]


def refine_mixtures(
    values: ValueFunction,
    jacobian: JacobianFunction,
    project: Callable[[Tensor, Tensor], Tensor],
    start: Tensor,
    present: Tensor,
    signals: Tensor,
    *,
    iterations: int,
    tolerance: float = 0.0,
) -> VarProResult:
    """Refines the parameters of S mixtures of up to M basis functions each [GP73].

    Args:
        values: maps coordinates `[s, M, P]` of the signals `rows [s]` to rho `[s, M, D]`.
        jacobian: maps them to rho `[s, M, D]` and d rho / d coordinates `[s, M, P, D]`.
        project: maps them to the nearest feasible coordinates `[s, M, P]`.
        start: `[S, M, P]`, feasible.
        present: `[S, M]` bool; False marks padding.
        signals: `[S, C, D]`.
        iterations: most steps.
        tolerance: a mixture has converged when a step lowers its loss by no more than this
            fraction.

    Returns:
        Coordinates, weights, loss and status of each mixture.
    """
    state = _State.begin(values, start, present, signals)
    failed, first = ~torch.isfinite(state.loss), state.loss.clone()
    rows = torch.nonzero(~failed).squeeze(1)  # mixtures that still run
    for _ in range(iterations):
        if not len(rows):
            break
        now = state.take(rows)
        rho, derivative = jacobian(now.coordinates, rows)
        step, usable = _step(
            rho, derivative, now.weights, present[rows], signals[rows], now.damping
        )
        failed[rows] = ~usable
        trial = project(now.coordinates + step.to(start.dtype), rows)
        fit = _evaluate(values(trial, rows), present[rows], signals[rows])
        gain = now.loss - fit.loss
        state.put(rows, now.moved(trial, fit, gain > 0.0))  # False for NaN
        settled = (gain >= 0.0) & (gain <= tolerance * now.loss)
        stuck = state.damping[rows] >= DAMPING_MAX
        rows = rows[~(settled | stuck) & usable]
    weights = state.weights.transpose(1, 2).to(start.dtype)
    stuck = (state.damping >= DAMPING_MAX) & (state.loss == first)
    converged = torch.ones_like(failed).index_fill_(0, rows, False)
    status = worst_status(converged, stuck, failed)
    return VarProResult(state.coordinates, weights, state.loss, status)


@dataclass
class _State:
    """Current point of every mixture."""

    coordinates: Tensor  # [S, M, P]
    weights: Tensor  # [S, C, M] float64
    loss: Tensor  # [S] float64
    damping: Tensor  # [S] float64

    @staticmethod
    def begin(values: ValueFunction, start: Tensor, present: Tensor, signals: Tensor) -> _State:
        """The start, with its weights and loss."""
        rows = torch.arange(len(start), device=start.device)
        fit = _evaluate(values(start, rows), present, signals)
        damping = torch.full_like(fit.loss, DAMPING_START)
        return _State(start.clone(), fit.weights, fit.loss, damping)

    def take(self, rows: Tensor) -> _State:
        """The state of the mixtures `rows`."""
        return _State(**{name: value[rows] for name, value in vars(self).items()})

    def put(self, rows: Tensor, other: _State) -> None:
        """Overwrites the mixtures `rows` in place."""
        for name, value in vars(self).items():
            value[rows] = getattr(other, name)

    def moved(self, trial: Tensor, fit: _Fit, better: Tensor) -> _State:
        """The state after a trial, which is taken where it is `better [S]`."""
        wide = better[:, None, None]
        return _State(
            torch.where(wide, trial, self.coordinates),
            torch.where(wide, fit.weights, self.weights),
            torch.where(better, fit.loss, self.loss),
            next_damping(self.damping, better),
        )


def _evaluate(rho: Tensor, present: Tensor, signals: Tensor) -> _Fit:
    """Solves the weights of given basis functions `rho [S, M, D]`."""
    gram = (rho @ rho.transpose(1, 2)).double()  # [S, M, M]
    correlation = (signals @ rho.transpose(1, 2)).double()  # [S, C, M]
    weights = nnls_shared_gram(gram, correlation, allowed=present).weights  # [S, C, M]
    error = signals - weights.to(rho.dtype) @ rho  # [S, C, D]
    return _Fit(weights, (error * error).sum((1, 2), dtype=torch.float64))


def _step(
    rho: Tensor,
    derivative: Tensor,
    weights: Tensor,
    present: Tensor,
    signals: Tensor,
    damping: Tensor,
) -> tuple[Tensor, Tensor]:
    """One damped Gauss-Newton step `[S, M, P]`, and where its gradient is finite `[S]`.

    The Jacobian of the model is `derivative [S, M, P, D]` times the weights.
    """
    s, m, p, _ = derivative.shape
    error = signals - weights.to(rho.dtype) @ rho  # [S, C, D]
    flat = derivative.flatten(1, 2)  # [S, M P, D]
    repeated = weights.repeat_interleave(p, dim=2)  # [S, C, M P]
    gradient = -(repeated * (error @ flat.transpose(1, 2)).double()).sum(1)  # [S, M P]
    coupling = repeated.transpose(1, 2) @ repeated  # [S, M P, M P]
    hessian = coupling * (flat @ flat.transpose(1, 2)).double()
    hessian = hessian - _projected_part(rho, flat, weights, repeated, present)
    step = damped_step(hessian, gradient, damping).view(s, m, p)
    return step, torch.isfinite(gradient).all(1)


def damped_step(hessian: Tensor, gradient: Tensor, damping: Tensor) -> Tensor:
    """Marquardt's step of S problems [Mar63].

    Args:
        hessian: Hessian or its Gauss-Newton approximation, `[S, N, N]` float64.
        gradient: `[S, N]` float64.
        damping: `[S]` float64, relative to the diagonal of the Hessian.

    Returns:
        Step `[S, N]`; 0 for parameters without effect, and for problems without a finite step.
    """
    diagonal = hessian.diagonal(dim1=1, dim2=2).clamp(min=0.0)
    floor = RELATIVE_RIDGE * diagonal.mean(1, keepdim=True) + torch.finfo(torch.float32).tiny
    idle = diagonal <= floor  # padding, or a parameter without effect
    scale = (diagonal + floor).rsqrt()
    system = hessian * scale[:, :, None] * scale[:, None, :]
    system = system + torch.diag_embed(damping[:, None] + RELATIVE_RIDGE + idle.double())
    step, info = torch.linalg.solve_ex(system, -(gradient * scale)[..., None])
    step = step.squeeze(-1) * scale * ~idle
    usable = (info == 0)[:, None] & torch.isfinite(step)
    return torch.where(usable, step, 0.0)


def next_damping(damping: Tensor, better: Tensor) -> Tensor:
    """The damping `[S]` after a trial, given whether it was `better [S]` [Mar63]."""
    factor = torch.where(better, DAMPING_DOWN, DAMPING_UP)
    return (damping * factor).clamp(DAMPING_MIN, DAMPING_MAX)


def _projected_part(
    rho: Tensor, flat: Tensor, weights: Tensor, repeated: Tensor, present: Tensor
) -> Tensor:
    """Part of the Hessian that a change of the weights absorbs [Kau75]: `[S, M P, M P]`."""
    cross = (rho @ flat.transpose(1, 2)).double()  # [S, M, M P]
    gram = (rho @ rho.transpose(1, 2)).double()
    passive = ((weights > 0.0) & present[:, None]).double()  # [S, C, M]
    unit = torch.diag_embed(1.0 - passive)
    ridge = RELATIVE_RIDGE * gram.diagonal(dim1=1, dim2=2).mean(1)[:, None, None, None]
    eye = torch.eye(gram.shape[1], dtype=gram.dtype, device=gram.device)
    masked = gram[:, None] * passive[..., :, None] * passive[..., None, :] + unit + ridge * eye
    weighted = passive[..., None] * cross[:, None] * repeated[:, :, None, :]  # [S, C, M, M P]
    factor, _ = torch.linalg.cholesky_ex(masked)
    white = torch.linalg.solve_triangular(factor, weighted, upper=False)
    return torch.einsum("scma,scmb->sab", white, white)
