"""Non-negative stagewise Lasso with forward and backward steps, in Gram form.

All problems advance together. The state of a problem is its J weights x and the J correlations
g = D^T (y - D x) of its residual, so a step costs one column of the Gram and no pass over the data.

References:
    [ZY07] Peng Zhao, Bin Yu, Stagewise Lasso, Journal of Machine Learning Research 8, 2007, §3.1
        (BLasso).
    [WDR11] Hongzhi Wu, Julie Dorsey, Holly Rushmeier, A Sparse Parametric Mixture Model for BTF
        Compression, Editing and Rendering, Computer Graphics Forum 30(2) (Eurographics), 2011,
        §3.2, Eq. 4.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from .status import STATUS_DTYPE, Status

# xi of [ZY07] in units of eta^2: above the float32 rounding of the loss, far under one step.
STEP_TOLERANCE = 1e-3
# Relative slack of the threshold: a weight of exactly 2 eta must not be lost to rounding.
THRESHOLD_SLACK = 1e-3
# Steps between two checks for finished problems; each check waits for the device.
STEPS_PER_CHECK = 16
# Finished problems leave the batch when less than this fraction of it is still running.
COMPACT_BELOW = 0.75
# Weights in one block on the CPU: enough to hide the cost of a call, few enough for memory.
CPU_BLOCK_ELEMENTS = 2**19


@dataclass(frozen=True)
class StagewiseResult:
    """End of the path of each problem.

    Attributes:
        weights: `[B, J]`, non-negative whole multiples of eta.
        lambda_: regularization reached, `[B]`.
        steps: forward and backward steps taken, `[B]` long.
        backward_steps: backward steps taken, `[B]` long.
        status: `[B]` int8. CONVERGED: the path ended at `lambda_min` or where no forward step
            lowers the loss. LIMIT: of steps. NOT_FINITE: of eta, a correlation or the Gram.
    """

    weights: Tensor
    lambda_: Tensor
    steps: Tensor
    backward_steps: Tensor
    status: Tensor


@dataclass
class _State:
    """Running problems in units of eta."""

    row: Tensor  # [B] long, place in the block
    count: Tensor  # [B, J], weights x / eta
    correlation: Tensor  # [B, J], g / eta
    penalty: Tensor  # [B], lambda / eta
    floor: Tensor  # [B], lambda_min / eta
    running: Tensor  # [B] bool
    steps: Tensor  # [B] long
    backward_steps: Tensor  # [B] long

    def take(self, rows: Tensor) -> _State:
        """The problems in some rows of the state."""
        return _State(**{name: value[rows] for name, value in vars(self).items()})


def stagewise_lasso(
    gram: Tensor,
    correlation: Tensor,
    *,
    eta: Tensor,
    lambda_min: Tensor,
    max_steps: int,
    tolerance: float = STEP_TOLERANCE,
    cpu_block: int = CPU_BLOCK_ELEMENTS,
) -> StagewiseResult:
    """Follows the path of ||y - D x||^2 + lambda sum(x), x >= 0, in steps of eta [ZY07].

    Each problem has its own step and its own lambda. A step is backward on the active atom of
    least loss increase where that lowers the penalized loss by more than xi, else forward on the
    atom of largest loss decrease; lambda falls only on forward steps. A problem ends when no
    forward step lowers the loss at a lambda above `lambda_min`, or after `max_steps`.

    Args:
        gram: D^T D of unit-norm atoms, shared `[J, J]` or one a problem `[B, J, J]`.
        correlation: D^T y, `[B, J]`.
        eta: step size `[B]`; a problem with eta <= 0 keeps zero weights.
        lambda_min: smallest regularization `[B]`, for a loss without the factor 1/2 [WDR11 Eq. 4].
        max_steps: cap on forward plus backward steps.
        tolerance: xi of [ZY07], in units of eta^2.
        cpu_block: weights of one block on a CPU; on a GPU there is one block.

    Returns:
        Weights, lambda, numbers of steps and status of each problem.
    """
    batch, atoms = correlation.shape
    eta = eta.to(correlation).expand(batch)
    lambda_min = lambda_min.to(correlation).clamp_min(0).expand(batch)
    block = max(1, batch)
    if correlation.device.type == "cpu":
        block = max(1, cpu_block // max(1, atoms))
    parts = [
        _run_block(
            gram if gram.dim() == 2 else gram[first : first + block],
            correlation[first : first + block],
            eta[first : first + block],
            lambda_min[first : first + block],
            max_steps,
            tolerance,
        )
        for first in range(0, max(1, batch), block)
    ]
    count, penalty, steps, backward_steps, status = (
        torch.cat(values) for values in zip(*parts, strict=True)
    )
    lambda_ = penalty * eta
    status = status.masked_fill(~lambda_.isfinite(), Status.NOT_FINITE)
    return StagewiseResult(count * eta[:, None], lambda_, steps, backward_steps, status)


def lasso_threshold(weights: Tensor, eta: Tensor, *, factor: float = 2.0) -> Tensor:
    """Sets weights under `factor` eta to zero [WDR11 §3.2: a typical threshold is 2 eta].

    Args:
        weights: `[B, J]`.
        eta: `[B]`.
        factor: threshold in steps.

    Returns:
        Thresholded weights `[B, J]`.
    """
    least = (factor * (1 - THRESHOLD_SLACK)) * eta[:, None]  # [B, 1]
    return torch.where(weights < least, 0.0, weights)


def _run_block(
    gram: Tensor,
    correlation: Tensor,
    eta: Tensor,
    lambda_min: Tensor,
    max_steps: int,
    tolerance: float,
) -> tuple[Tensor, Tensor, Tensor, Tensor, Tensor]:
    """Runs one block to its end.

    Returns:
        Count `[B, J]`, lambda / eta, steps, backward steps and status, each `[B]`.
    """
    state = _start(correlation, eta, lambda_min)
    count = torch.zeros_like(correlation)
    penalty, steps = state.penalty.clone(), state.steps.clone()
    backward_steps = state.steps.clone()
    status = torch.full_like(steps, Status.CONVERGED, dtype=STATUS_DTYPE)
    gram = gram.to(correlation.dtype)
    for step in range(max_steps + 1):
        if step % STEPS_PER_CHECK == 0 or step == max_steps:
            running = state.running.nonzero()[:, 0]
            last = running.numel() == 0 or step == max_steps
            if last or running.numel() < COMPACT_BELOW * state.row.numel():
                count[state.row], penalty[state.row] = state.count, state.penalty
                steps[state.row], backward_steps[state.row] = state.steps, state.backward_steps
                state = state.take(running)
            if last:
                status[state.row] = Status.LIMIT
                break
        _advance(state, gram, tolerance)
    # A problem that never ran has a zero signal, so zero weights for any lambda.
    idle = penalty.isinf() & (steps == 0)
    return count, torch.where(idle, 0.0, penalty), steps, backward_steps, status


def _start(correlation: Tensor, eta: Tensor, lambda_min: Tensor) -> _State:
    batch = correlation.shape[0]
    valid = eta > 0
    unit = torch.where(valid, 1 / eta, 0.0)  # [B]
    return _State(
        row=torch.arange(batch, device=correlation.device),
        count=torch.zeros_like(correlation),
        correlation=correlation * unit[:, None],
        penalty=torch.full_like(eta, torch.inf),
        floor=lambda_min * unit,
        running=valid.clone(),
        steps=torch.zeros(batch, dtype=torch.long, device=correlation.device),
        backward_steps=torch.zeros(batch, dtype=torch.long, device=correlation.device),
    )


def _advance(state: _State, gram: Tensor, tolerance: float) -> None:
    """One step of every running problem, in place.

    In units of eta a forward step on a unit atom lowers the loss by 2 g_j - 1 and a backward step
    raises it by 2 g_j + 1. The first step has penalty = inf, which makes it lambda_0 of [ZY07].
    """
    highest, forward_atom = state.correlation.max(-1)  # [B]
    active = torch.where(state.count > 0, state.correlation, torch.inf)
    lowest, backward_atom = active.min(-1)  # [B], inf without active atoms
    backward = 2 * lowest + 1 - state.penalty < -tolerance
    backward &= state.running
    reached = torch.minimum(state.penalty, 2 * highest - 1 - tolerance)
    forward = state.running & ~backward & (reached > state.floor)
    ended = state.running & ~backward & ~forward
    # The final x is the solution down to the lambda of the step that is not taken.
    lowered = torch.minimum(torch.maximum(reached, state.floor), state.penalty)
    state.penalty = torch.where(forward | ended, lowered, state.penalty)
    state.running = state.running & ~ended
    state.steps += state.running
    state.backward_steps += backward
    atom = torch.where(backward, backward_atom, forward_atom)  # [B]
    sign = forward.to(highest.dtype) - backward.to(highest.dtype)  # [B], 0 for ended problems
    state.count.scatter_add_(1, atom[:, None], sign[:, None])
    column = gram[atom] if gram.dim() == 2 else gram[state.row, atom]  # [B, J]
    state.correlation.addcmul_(column, sign[:, None], value=-1)
