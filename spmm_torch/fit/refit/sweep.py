"""One turn of alternating least squares: functions of the residual for given coefficients.

A pair of directions tells its own value of every function, apart from all other pairs. So the pass
that fits the functions of a view also gives their products with the pictures of that view, from
which the next coefficients follow.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import torch
from torch import Tensor

from ...data import BTF
from ...model.lookup import SparseWeights
from ...runtime.ranks import Ranks
from .lookups import Lookups
from .matrices import channel_matrices, rows_by_view, side_by_side, solve_with_ridge

# Ridge relative to the mean diagonal: views that show little leave functions undetermined.
RIDGE = 1e-4


@dataclass(frozen=True)
class Swept:
    """Functions of least error for some coefficients.

    Attributes:
        functions: without the weights of pairs, `[V, R, L, C]`.
        products: sum_v < B_r(v, .), (W_v^T E_v)[q, .] > with what the lobes leave, with the weights
            of pairs, `[T, R]` float64.
    """

    functions: Tensor
    products: Tensor

    def to_tensors(self) -> dict[str, Tensor]:
        """Tensors for a checkpoint: `functions [V, R, L, C]` and `products [T, R]`."""
        return dict(vars(self))

    @classmethod
    def from_tensors(cls, tensors: dict[str, Tensor]) -> Swept:
        """The functions of a checkpoint; see `Swept.to_tensors`."""
        return cls(**tensors)

    def to(self, device: torch.device) -> Swept:
        """The same on another device: what a checkpoint held is on the CPU."""
        return Swept(self.functions.to(device), self.products.to(device))


def sweep(
    pictures: BTF,
    scale: Tensor | None,
    lookups: Lookups,
    entries: SparseWeights,
    rho: Tensor,
    coefficient: Tensor,
    ranks: Ranks,
    advance: Callable[[int], object],
    *,
    kept: Tensor | None = None,
) -> Swept:
    """Reads all pictures once; every rank has a part of the views.

    Args:
        pictures: as they were measured.
        scale: square roots of the weights of pairs, `[D]`; None: 1.
        lookups: what each pixel shows, with the weights of pixels.
        entries: fit of all texels.
        rho: values of the lobes without weights of pairs, `[V, J, L]`.
        coefficient: c, `[T, R]`.
        ranks: processes among which the views are divided.
        advance: called with the number of views done.
        kept: share of the functions to keep at each pair, `[V, L]`; None: 1.
    """
    device, rank = rho.device, coefficient.shape[1]
    lights, channels = len(pictures.light), pictures.channels
    functions = torch.zeros(lookups.views, rank, lights, channels, device=device)
    products = torch.zeros(coefficient.shape, dtype=torch.float64, device=device)
    weights = channel_matrices(entries, rho.shape[1])
    for run in lookups.runs(*ranks.span(lookups.views)):
        picture = pictures.planes(run.start, run.stop).to(device)  # [C, T, n L]
        if lookups.pixel is not None:
            picture = picture * lookups.pixel[:, None]
        drawn = lookups.drawn(run, apart=True)
        rows = picture.unflatten(2, (-1, lights)).transpose(1, 2).flatten(1, 2)  # [C, n T, L]
        for plane, weight in zip(rows, weights, strict=True):
            plane -= drawn @ rows_by_view(weight @ side_by_side(rho[run]), run)  # what lobes leave
        left = rows.unflatten(1, (-1, len(coefficient))).transpose(0, 1)  # [n, C, T, L]
        seen = (lookups.drawn(run) @ coefficient).unflatten(0, (-1, len(coefficient)))  # [n, T, R]
        found = solve_with_ridge(*_normal_equations(seen, left), RIDGE)  # [n, C, R, L]
        if kept is not None:
            found = found * kept[run][:, None, None]
        functions[run] = found.permute(0, 2, 3, 1)
        if scale is not None:
            found = found * scale.view(-1, 1, 1, lights)[run].square()
        shown = (left @ found.transpose(2, 3)).sum(1)  # [n, T, R]
        products += lookups.gathered(run) @ shown.flatten(0, 1)
        advance(ranks.size * (run.stop - run.start))
    return Swept(ranks.sum(functions), ranks.sum(products))


def _normal_equations(seen: Tensor, left: Tensor) -> tuple[Tensor, Tensor]:
    """Matrices `[n, 1, R, R]` and right sides `[n, C, R, L]` of the functions of n views.

    Args:
        seen: coefficients as the views show them, `[n, T, R]`.
        left: what they are fit to, `[n, C, T, L]`.
    """
    if len(seen) == 1:  # one product of matrices, which a CPU splits among its threads
        alone = seen[0].T
        return (alone @ seen[0])[None, None], (alone @ left[0])[None]
    across = seen.transpose(1, 2)  # [n, R, T]
    return (across @ seen)[:, None], across[:, None] @ left
