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

# Steps on a GPU after each of which the host waits to know how many mixtures go on. Those that have
# ended are left out once they are the larger part: it takes as many operations as a part of a step.
CUDA_STEPS = 2

# Both take coordinates `[s, M, P]` and the indices `[s]` of their signals.
ValueFunction = Callable[[Tensor, Tensor], Tensor]
LinearFunction = Callable[[Tensor, Tensor], Tensor]


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


@dataclass
class _State:
    """Current point of every mixture, and the Gauss-Newton model of the loss there."""

    coordinates: Tensor  # [S, M, P]
    weights: Tensor  # [S, C, M] float64
    loss: Tensor  # [S] float64
    gradient: Tensor  # [S, M P] float64, of half the loss
    hessian: Tensor  # [S, M P, M P] float64
    damping: Tensor  # [S] float64
    running: Tensor  # [S] bool
    failed: Tensor  # [S] bool, a loss at the start or a gradient was not finite

    def take(self, rows: Tensor) -> _State:
        """The state of the mixtures `rows`."""
        return _State(*(value[rows] for value in vars(self).values()))

    def put(self, rows: Tensor, other: _State) -> None:
        """Overwrites the mixtures `rows` in place, unless the other state is this one."""
        if other is self:
            return
        for mine, theirs in zip(vars(self).values(), vars(other).values(), strict=True):
            mine[rows] = theirs

    def moved(self, trial: _State, tolerance: float) -> _State:
        """The state after a trial, which is taken where it lowers the loss of one that runs."""
        unusable = _not_finite(self.gradient).any(1)
        gain = self.loss - trial.loss
        better = self.running & (gain > 0.0)  # False for NaN
        points = [
            torch.where(better.view(-1, *[1] * (mine.dim() - 1)), theirs, mine)
            for mine, theirs in zip(self._point(), trial._point(), strict=True)
        ]
        damping = torch.where(self.running, next_damping(self.damping, better), self.damping)
        settled = (gain >= 0.0) & (gain <= tolerance * self.loss)
        ended = settled | (damping >= DAMPING_MAX) | unusable
        failed = self.failed | (self.running & unusable)
        return _State(*points, damping=damping, running=self.running > ended, failed=failed)

    def _point(self) -> tuple[Tensor, ...]:
        return self.coordinates, self.weights, self.loss, self.gradient, self.hessian


def refine_mixtures(
    values: ValueFunction,
    linearize: LinearFunction,
    project: Callable[[Tensor, Tensor], Tensor],
    start: Tensor,
    present: Tensor,
    signals: Tensor,
    *,
    iterations: int,
    tolerance: float = 0.0,
    stragglers: float = 0.0,
    block: int | None = None,
) -> VarProResult:
    """Refines the parameters of S mixtures of up to M basis functions each [GP73].

    A trial is linearized at once: most are taken, and a rejected one leaves the last model as it
    is.

    Args:
        values: maps coordinates `[s, M, P]` of the signals `rows [s]` to rho `[s, M, D]`.
        linearize: maps them to rho and d rho / d coordinates, `[s, M, 1 + P, D]`.
        project: maps them to the nearest feasible coordinates `[s, M, P]`.
        start: `[S, M, P]`, feasible.
        present: `[S, M]` bool; False marks padding.
        signals: `[S, C, D]`.
        iterations: most steps.
        tolerance: a mixture has converged when a step lowers its loss by no more than this
            fraction.
        stragglers: fraction of the mixtures that may be left unconverged: no step is taken for
            fewer than that, since it costs a device as many operations as one for all.
        block: mixtures that are evaluated at once; None: all.

    Returns:
        Coordinates, weights, loss and status of each mixture.
    """
    rows = torch.arange(len(start), device=start.device)
    problem = _Problem(values, linearize, present, signals, rows, block)
    state = problem.at(start.clone(), slopes=iterations > 0)
    first, now = state.loss.clone(), state
    for number in range(iterations):
        if not rows.is_cuda or number % CUDA_STEPS == 0:
            kept = now.running.nonzero().squeeze(1)
            if len(kept) <= int(stragglers * len(start)):
                break
            if len(kept) <= len(rows) // 2 if rows.is_cuda else len(kept) < len(rows):
                state.put(rows, now)
                now, problem = now.take(kept), problem.take(kept)
                rows = problem.rows
        step = damped_step(now.hessian, now.gradient, now.damping).view_as(now.coordinates)
        trial = project(now.coordinates + step.to(start.dtype), rows)
        now = now.moved(problem.at(trial, slopes=number < iterations - 1), tolerance)
    state.put(rows, now)
    weights = state.weights.transpose(1, 2).to(start.dtype)
    stuck = (state.damping >= DAMPING_MAX) & (state.loss == first)
    status = worst_status(~state.running, stuck, state.failed)
    return VarProResult(state.coordinates, weights, state.loss, status)


@dataclass(frozen=True)
class _Problem:
    """What `refine_mixtures` was given of the mixtures that still run."""

    values: ValueFunction
    linearize: LinearFunction
    present: Tensor  # [s, M]
    signals: Tensor  # [s, C, D]
    rows: Tensor  # [s], among all mixtures
    block: int | None

    def take(self, kept: Tensor) -> _Problem:
        """The problem of the mixtures `kept` of these."""
        present, signals, rows = self.present[kept], self.signals[kept], self.rows[kept]
        return _Problem(self.values, self.linearize, present, signals, rows, self.block)

    def at(self, coordinates: Tensor, *, slopes: bool) -> _State:
        """Fresh states at coordinates `[s, M, P]`."""
        size = self.block or len(self.rows)
        given = coordinates, self.rows, self.present, self.signals
        if len(self.rows) <= size:
            return self._block(*given, slopes)
        split = zip(*(part.split(size) for part in given), strict=True)
        parts = [vars(self._block(a, b, c, d, slopes)).values() for a, b, c, d in split]
        return _State(*(torch.cat(column) for column in zip(*parts, strict=True)))

    def _block(
        self, coordinates: Tensor, rows: Tensor, present: Tensor, signals: Tensor, slopes: bool
    ) -> _State:
        found = self.linearize(coordinates, rows) if slopes else None  # [s, M, 1 + P, D]
        products = None if found is None else _products(found)
        rho = self.values(coordinates, rows) if found is None else found[:, :, 0]
        gram = rho @ rho.transpose(1, 2) if products is None else products[:, :, 0, :, 0]
        correlation = (signals @ rho.transpose(1, 2)).double()  # [s, C, M]
        weights = nnls_shared_gram(gram.double(), correlation, allowed=present).weights
        error = signals - weights.to(rho.dtype) @ rho  # [s, C, D]
        loss = (error * error).sum((1, 2), dtype=torch.float64)
        if found is None or products is None:
            size = coordinates.shape[1] * coordinates.shape[2]
            gradient = loss.new_zeros(len(rows), size)
            hessian = loss.new_zeros(len(rows), size, size)
        else:
            flat = found.flatten(1, 2)
            along = (error @ flat.transpose(1, 2)).unflatten(2, found.shape[1:3])[..., 1:]
            gradient, hessian = _model(products.double(), along.double(), weights)
        damping, failed = torch.full_like(loss, DAMPING_START), _not_finite(loss)
        return _State(coordinates, weights, loss, gradient, hessian, damping, ~failed, failed)


def _not_finite(values: Tensor) -> Tensor:
    """True where `values [...]` are NaN or infinite, in two operations where torch takes five."""
    return (values - values) != 0.0


def _products(found: Tensor) -> Tensor:
    """Inner products over pairs of all rows `[s, M, 1 + P, D]`, `[s, M, 1 + P, M, 1 + P]`."""
    flat, shape = found.flatten(1, 2), found.shape[1:3]
    return (flat @ flat.transpose(1, 2)).unflatten(1, shape).unflatten(3, shape)


def _model(products: Tensor, along: Tensor, weights: Tensor) -> tuple[Tensor, Tensor]:
    """Gradient `[S, M P]` and Gauss-Newton Hessian `[S, M P, M P]` of half the loss.

    Args:
        products: inner products of values and derivatives, `[S, M, 1 + P, M, 1 + P]`.
        along: those of the derivatives with the error of each channel, `[S, C, M, P]`.
        weights: `[S, C, M]`.
    """
    parameters = along.shape[3]
    gradient = -(weights[..., None] * along).sum(1).flatten(1)
    repeated = weights.repeat_interleave(parameters, dim=2)  # [S, C, M P]
    coupling = repeated.transpose(1, 2) @ repeated  # [S, M P, M P]
    inner = products[:, :, 1:, :, 1:].flatten(1, 2).flatten(2)  # [S, M P, M P]
    gram, cross = products[:, :, 0, :, 0], products[:, :, 0, :, 1:].flatten(2)
    return gradient, coupling * inner - _projected_part(gram, cross, weights, repeated)


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
    system.diagonal(dim1=1, dim2=2).add_(damping[:, None] + RELATIVE_RIDGE + idle)
    step, info = torch.linalg.solve_ex(system, -(gradient * scale)[..., None])
    step = step.squeeze(-1) * scale * ((info == 0)[:, None] > idle)
    return step.nan_to_num_(0.0, 0.0, 0.0)


def next_damping(damping: Tensor, better: Tensor) -> Tensor:
    """The damping `[S]` after a trial, given whether it was `better [S]` [Mar63]."""
    moved = torch.where(better, damping * DAMPING_DOWN, damping * DAMPING_UP)
    return moved.clamp(DAMPING_MIN, DAMPING_MAX)


def _projected_part(gram: Tensor, cross: Tensor, weights: Tensor, repeated: Tensor) -> Tensor:
    """Part of the Hessian that a change of the weights absorbs [Kau75]: `[S, M P, M P]`.

    Args:
        gram: inner products of the basis functions, `[S, M, M]`.
        cross: those with the derivatives, `[S, M, M P]`.
        weights: `[S, C, M]`.
        repeated: the same for each derivative, `[S, C, M P]`.
    """
    passive = (weights > 0.0).double()  # [S, C, M]; those of padding are 0
    ridge = RELATIVE_RIDGE * gram.diagonal(dim1=1, dim2=2).mean(1)[:, None, None]
    masked = gram[:, None] * passive[..., :, None] * passive[..., None, :]
    masked.diagonal(dim1=2, dim2=3).add_(1.0 - passive).add_(ridge)
    weighted = passive[..., None] * cross[:, None] * repeated[:, :, None, :]  # [S, C, M, M P]
    factor, _ = torch.linalg.cholesky_ex(masked)
    white = torch.linalg.solve_triangular(factor, weighted, upper=False)
    return torch.einsum("scma,scmb->sab", white, white)
