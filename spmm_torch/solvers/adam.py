"""Batched projected Adam, which keeps the best point of every row.

References:
    [KB15] Diederik P. Kingma, Jimmy Ba, Adam: A Method for Stochastic Optimization, International
        Conference on Learning Representations (ICLR), 2015, algorithm 1.
"""

from __future__ import annotations

import torch
from torch import Tensor

from .lbfgs import Objective, OptimizeResult, Projection
from .status import worst_status

FIRST_DECAY, SECOND_DECAY = 0.9, 0.999  # defaults of [KB15 §2]
# [KB15 §2] has 1e-8 for gradients near 1. This is smaller, so the units of a value do not matter.
EPSILON = 1e-12


def minimize_adam(
    objective: Objective,
    start: Tensor,
    project: Projection,
    *,
    steps: int,
    learning_rate: float | Tensor,
) -> OptimizeResult:
    """Runs Adam with a projection after each step; elementwise, so rows are independent [KB15].

    Args:
        objective: maps `[R, P]` to values `[R]` and gradients `[R, P]`, row by row.
        start: `[R, P]`; projected first.
        project: projection on the feasible set, row by row.
        steps: gradient steps; the objective is called once more.
        learning_rate: step length in units of x, a number or a tensor that broadcasts with
            `[R, P]`.

    Returns:
        Best point and value of each row. A row that meets NaN or infinity stays at its best point
        and ends NOT_FINITE. Every other row ends at the LIMIT of steps: Adam has no stopping rule.
    """
    x = project(start)
    best, best_value = x, torch.full_like(x[:, 0], torch.inf)
    failed = torch.zeros_like(best_value, dtype=torch.bool)
    mean, variance = torch.zeros_like(x), torch.zeros_like(x)
    for step in range(1, steps + 2):
        value, grad = objective(x)
        failed = failed | ~(value.isfinite() & grad.isfinite().all(-1))
        improved = ~failed & (value < best_value)
        best = torch.where(improved[:, None], x, best)
        best_value = torch.where(improved, value, best_value)
        if step > steps:
            break
        mean = FIRST_DECAY * mean + (1 - FIRST_DECAY) * grad
        variance = SECOND_DECAY * variance + (1 - SECOND_DECAY) * grad.square()
        unbiased = mean / (1 - FIRST_DECAY**step)
        spread = (variance / (1 - SECOND_DECAY**step)).sqrt()
        moved = project(x - learning_rate * unbiased / (spread + EPSILON))
        x = torch.where(failed[:, None], best, moved)
    none = torch.zeros_like(failed)
    return OptimizeResult(best, best_value, worst_status(none, none, failed))
