"""Small non-negative mixtures of least error, where errors are a function of the values.

Minimizes over w >= 0 and x the sum of a penalty of the values s = sum_m w_cm rho_m(x_m), such as
squared errors of cube roots, by Levenberg-Marquardt [Mar63] over weights and parameters together.
The Gram matrix differs from channel to channel, so that weights are not solved inside as by
`refine_mixtures`.

References:
    [Mar63] Donald W. Marquardt, An Algorithm for Least-Squares Estimation of Nonlinear Parameters,
        Journal of the Society for Industrial and Applied Mathematics 11(2), 1963.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import torch
from torch import Tensor

from .varpro import LinearFunction, State, VarProResult, descend

# Maps values `[s, C, D]` of the signals `rows [s]` to the penalty `[s]` float64, half its gradient
# along the values and half its curvature, both `[s, C, D]`.
Penalty = Callable[[Tensor, Tensor], tuple[Tensor, Tensor, Tensor]]


def refine_curved(
    linearize: LinearFunction,
    project: Callable[[Tensor, Tensor], Tensor],
    penalty: Penalty,
    start: Tensor,
    weights: Tensor,
    present: Tensor,
    *,
    iterations: int,
    tolerance: float = 0.0,
    block: int | None = None,
) -> VarProResult:
    """Refines parameters and weights of S mixtures of up to M basis functions each.

    Args:
        linearize: maps coordinates `[s, M, P]` of the signals `rows [s]` to rho and d rho /
            d coordinates, `[s, M, 1 + P, D]`.
        project: maps them to the nearest feasible coordinates `[s, M, P]`.
        penalty: of values.
        start: `[S, M, P]`, feasible.
        weights: at the start, `[S, M, C]`, non-negative.
        present: `[S, M]` bool; False marks padding.
        iterations: most steps.
        tolerance: a mixture has converged when a step lowers its loss by no more than this
            fraction.
        block: mixtures that are evaluated at once; None: all.

    Returns:
        Coordinates, weights and loss of each mixture, of which none is above that of the start.
    """
    size = start.shape[2]

    def feasible(joint: Tensor, rows: Tensor) -> Tensor:
        return torch.cat((project(joint[..., :size], rows), joint[..., size:].clamp(min=0.0)), -1)

    problem = _Curved(linearize, penalty, present, size)
    joint = torch.cat((start, weights * present[..., None]), dim=-1)
    found = descend(
        problem, feasible, joint, iterations=iterations, tolerance=tolerance, block=block
    )
    return VarProResult(
        found.coordinates[..., :size], found.coordinates[..., size:], found.loss, found.status
    )


@dataclass(frozen=True)
class _Curved:
    """What `refine_curved` was given of all mixtures; its coordinates are `[S, M, P + C]`."""

    linearize: LinearFunction
    penalty: Penalty
    present: Tensor  # [S, M]
    size: int  # P

    def at(self, coordinates: Tensor, rows: Tensor, slopes: bool) -> State:
        """Fresh states at coordinates `[s, M, P + C]` of the mixtures `rows [s]`."""
        found = self.linearize(coordinates[..., : self.size], rows)  # [s, M, 1 + P, D]
        weights = coordinates[..., self.size :].transpose(1, 2)  # [s, C, M]
        loss, gradient, curvature = self.penalty(weights @ found[:, :, 0], rows)
        count = coordinates.shape[1] * coordinates.shape[2]
        if not slopes:
            empty = loss.new_zeros(len(rows), count)
            return State.fresh(coordinates, weights, loss, empty, empty[..., None] * empty[:, None])
        flat = found.flatten(1, 2)  # [s, K, D]
        along = (gradient @ flat.transpose(1, 2)).double()  # [s, C, K]
        gram = [(flat * one[:, None]) @ flat.transpose(1, 2) for one in curvature.unbind(1)]
        chain = self._chain(weights.double())  # [s, C, N, K]
        half = (chain @ along[..., None]).squeeze(-1).sum(1)  # [s, N]
        hessian = (chain @ torch.stack(gram, 1).double() @ chain.transpose(2, 3)).sum(1)
        free = self._free(coordinates, half, rows)
        both = free[:, :, None] & free[:, None]
        return State.fresh(coordinates, weights, loss, half * free, hessian * both)

    def _chain(self, weights: Tensor) -> Tensor:
        """Derivatives of the values of each channel, in terms of rho and its derivatives.

        Args:
            weights: `[s, C, M]`.

        Returns:
            `[s, C, M (P + C), M (1 + P)]`.
        """
        samples, channels, slots = weights.shape
        chain = weights.new_zeros(
            samples, channels, slots, self.size + channels, slots, 1 + self.size
        )
        for slot in range(slots):
            own = chain[:, :, slot, :, slot]  # [s, C, P + C, 1 + P]
            own[:, :, : self.size, 1:].diagonal(dim1=2, dim2=3).copy_(
                weights[:, :, slot, None].expand(-1, -1, self.size)
            )
            own[:, :, self.size :, 0] = torch.eye(channels).to(weights)
        return chain.flatten(4, 5).flatten(2, 3)

    def _free(self, coordinates: Tensor, gradient: Tensor, rows: Tensor) -> Tensor:
        """True `[s, M (P + C)]` but for padding and weights that would leave 0 downward."""
        free = torch.ones_like(coordinates, dtype=torch.bool)
        held = coordinates[..., self.size :] <= 0.0
        free[..., self.size :] = ~held | (gradient.view_as(coordinates)[..., self.size :] < 0.0)
        return (free & self.present[rows][..., None]).flatten(1)
