"""Variable projection: all nonlinear parameters of small non-negative mixtures at once, in a batch.

Minimizes over x the function min_{w >= 0} sum_c ||y_c - sum_m w_cm rho_m(x_m)||^2 of S independent
signals by Levenberg-Marquardt with Kaufman's approximation [Golub and Pereyra 1973, Kaufman 1975]:
the weights are solved inside, so only the shape of the basis functions is searched.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import torch
from torch import Tensor

from .nnls import nnls_channels

# Marquardt's damping: its start, its bounds, and how it reacts to a good and a bad step.
DAMPING_START, DAMPING_MIN, DAMPING_MAX = 1e-2, 1e-7, 1e7
DAMPING_DOWN, DAMPING_UP = 1.0 / 3.0, 4.0
# Added to a diagonal relative to its mean: a parameter without effect must not be singular.
RIDGE = 1e-7

ValueFunction = Callable[[Tensor, Tensor], Tensor]
JacobianFunction = Callable[[Tensor, Tensor], tuple[Tensor, Tensor]]


@dataclass(frozen=True)
class VarProResult:
    """The refined mixtures.

    Attributes:
        coordinates: `[S, M, P]`.
        weights: non-negative, `[S, M, C]`.
        loss: remaining squared error `[S]`.
        failed: `[S]`, True where a loss or slope was NaN or infinite at a point that others were
            to follow; the best point before that is returned.
        stuck: `[S]`, True where no step, however short, lowered the loss of the start.
    """

    coordinates: Tensor
    weights: Tensor
    loss: Tensor
    failed: Tensor
    stuck: Tensor


@dataclass(frozen=True)
class _Fit:
    """The weights of S mixtures and what they leave, in float64."""

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
    """Refines the parameters of S mixtures of up to M basis functions each.

    Args:
        values: `(coordinates [s, M, P], rows [s]) -> rho [s, M, D]` for the signals `rows`.
        jacobian: the same -> (rho, d rho / d coordinates `[s, M, P, D]`).
        project: `(coordinates, rows) -> coordinates` feasible.
        start: `[S, M, P]`, feasible.
        present: `[S, M]` bool; False marks padding.
        signals: `[S, C, D]`.
        iterations: steps at most.
        tolerance: a mixture is done when a step lowers its loss by less than this share of it.
    """
    state = _State.begin(values, start, present, signals)
    failed, first = ~torch.isfinite(state.loss), state.loss.clone()
    rows = torch.nonzero(~failed).squeeze(1)  # those still moving
    for _ in range(iterations):
        if not len(rows):
            break
        now = state.take(rows)
        rho, slope = jacobian(now.coordinates, rows)
        step, usable = _step(rho, slope, now.weights, present[rows], signals[rows], now.damping)
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
    return VarProResult(state.coordinates, weights, state.loss, failed, stuck)


@dataclass
class _State:
    """Where every mixture stands."""

    coordinates: Tensor  # [S, M, P]
    weights: Tensor  # [S, C, M] float64
    loss: Tensor  # [S] float64
    damping: Tensor  # [S] float64

    @staticmethod
    def begin(values: ValueFunction, start: Tensor, present: Tensor, signals: Tensor) -> _State:
        rows = torch.arange(len(start), device=start.device)
        fit = _evaluate(values(start, rows), present, signals)
        damping = torch.full_like(fit.loss, DAMPING_START)
        return _State(start.clone(), fit.weights, fit.loss, damping)

    def take(self, rows: Tensor) -> _State:
        return _State(**{name: value[rows] for name, value in vars(self).items()})

    def put(self, rows: Tensor, other: _State) -> None:
        for name, value in vars(self).items():
            value[rows] = getattr(other, name)

    def moved(self, trial: Tensor, fit: _Fit, better: Tensor) -> _State:
        """The state after a trial, which counts where it is `better [S]`."""
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
    weights = nnls_channels(gram, correlation, allowed=present)  # [S, C, M]
    error = signals - weights.to(rho.dtype) @ rho  # [S, C, D]
    return _Fit(weights, (error * error).sum((1, 2), dtype=torch.float64))


def _step(
    rho: Tensor,
    slope: Tensor,
    weights: Tensor,
    present: Tensor,
    signals: Tensor,
    damping: Tensor,
) -> tuple[Tensor, Tensor]:
    """One damped Gauss-Newton step `[S, M, P]`, and whether there is one `[S]`."""
    s, m, p, _ = slope.shape
    error = signals - weights.to(rho.dtype) @ rho  # [S, C, D]
    flat = slope.flatten(1, 2)  # [S, M P, D]
    spread = weights.repeat_interleave(p, dim=2)  # [S, C, M P]
    gradient = -(spread * (error @ flat.transpose(1, 2)).double()).sum(1)  # [S, M P]
    share = spread.transpose(1, 2) @ spread  # [S, M P, M P]
    hessian = share * (flat @ flat.transpose(1, 2)).double()
    hessian = hessian - _projected_part(rho, flat, weights, spread, present)
    step = damped_step(hessian, gradient, damping).view(s, m, p)
    return step, torch.isfinite(gradient).all(1)


def damped_step(hessian: Tensor, gradient: Tensor, damping: Tensor) -> Tensor:
    """The step of Marquardt `[S, N]` of S problems.

    Args:
        hessian: or its Gauss-Newton approximation, `[S, N, N]` float64.
        gradient: `[S, N]` float64.
        damping: `[S]` float64, relative to the diagonal of the Hessian.

    Returns:
        0 for parameters without effect, and for problems that have no finite step.
    """
    diagonal = hessian.diagonal(dim1=1, dim2=2).clamp(min=0.0)
    floor = RIDGE * diagonal.mean(1, keepdim=True) + torch.finfo(torch.float32).tiny
    idle = diagonal <= floor  # no lobe there, or a parameter without effect
    scale = (diagonal + floor).rsqrt()
    system = hessian * scale[:, :, None] * scale[:, None, :]
    system = system + torch.diag_embed(damping[:, None] + RIDGE + idle.double())
    step, info = torch.linalg.solve_ex(system, -(gradient * scale)[..., None])
    step = step.squeeze(-1) * scale * ~idle
    usable = (info == 0)[:, None] & torch.isfinite(step)
    return torch.where(usable, step, 0.0)


def next_damping(damping: Tensor, better: Tensor) -> Tensor:
    """The damping after a trial that was `better` or not, both `[S]`."""
    factor = torch.where(better, DAMPING_DOWN, DAMPING_UP)
    return (damping * factor).clamp(DAMPING_MIN, DAMPING_MAX)


def _projected_part(
    rho: Tensor, flat: Tensor, weights: Tensor, spread: Tensor, present: Tensor
) -> Tensor:
    """What the weights can absorb of the slopes [Kaufman 1975]: `[S, M P, M P]`."""
    cross = (rho @ flat.transpose(1, 2)).double()  # [S, M, M P]
    gram = (rho @ rho.transpose(1, 2)).double()
    passive = ((weights > 0.0) & present[:, None]).double()  # [S, C, M]
    unit = torch.diag_embed(1.0 - passive)
    ridge = RIDGE * gram.diagonal(dim1=1, dim2=2).mean(1)[:, None, None, None]
    eye = torch.eye(gram.shape[1], dtype=gram.dtype, device=gram.device)
    masked = gram[:, None] * passive[..., :, None] * passive[..., None, :] + unit + ridge * eye
    weighted = passive[..., None] * cross[:, None] * spread[:, :, None, :]  # [S, C, M, M P]
    factor, _ = torch.linalg.cholesky_ex(masked)
    white = torch.linalg.solve_triangular(factor, weighted, upper=False)
    return torch.einsum("scma,scmb->sab", white, white)
