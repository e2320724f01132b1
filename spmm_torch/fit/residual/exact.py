"""Errors of very good fits, from the values themselves.

Errors from products are small differences of numbers as large as the energy, which float32 holds to
1e-7: beyond 60 dB they are rounding. One more pass over the texels gives the errors up to 130 dB
and more.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import torch
from torch import Tensor

from ...metrics import Totals
from ...runtime.ranks import ALONE, Ranks
from ..select.products import Load
from ..select.texels import Fit

# Relative error under which one more pass is made: rounding is 1 % of the error there.
DOUBTFUL = 1e-5


def is_doubtful(error: float, energy: float) -> bool:
    """Whether a squared error from products may be rounding."""
    return error < DOUBTFUL * energy


def exact_where_doubtful(
    totals: Totals,
    passes: tuple[Load, Sequence[slice]],
    fits: Sequence[Fit],
    atoms: Tensor,
    residual: Tensor,
    ranks: Ranks = ALONE,
    importance: Tensor | None = None,
) -> Totals:
    """The errors of a cluster, by one more pass where they may be rounding.

    Args:
        totals: from products.
        passes: load and parts, as in `exact_errors`.
        fits, residual, ranks, importance: as in `exact_errors`.
        atoms: `[J, D]`.
    """
    if not is_doubtful(min(totals.without_residual, totals.with_residual), totals.energy):
        return totals
    without, with_residual = exact_errors(*passes, fits, atoms, residual, ranks, importance)
    return replace(totals, without_residual=without, with_residual=with_residual)


def exact_errors(
    load: Load,
    parts: Sequence[slice],
    fits: Sequence[Fit],
    atoms: Tensor,
    residual: Tensor,
    ranks: Ranks = ALONE,
    importance: Tensor | None = None,
) -> tuple[float, float]:
    """Squared errors of a whole cluster (without its residual, with it), from the values.

    Args:
        load: gives the values `[m, C, D]` of some of the n texels of this rank.
        parts: blocks of the n texels.
        fits: of the n texels, in their order.
        atoms: `[J, D]`.
        residual: the stored values, `[D, C]`.
        ranks: processes among which the cluster is divided.
        importance: weights of the n texels, `[n]`; None: 1.
    """
    none = atoms.new_zeros(0, residual.shape[1], len(atoms))  # a rank may have no texels
    weights = torch.cat([none, *(_dense(fit, len(atoms)) for fit in fits)])  # [n, C, J]
    total = torch.zeros(2, dtype=torch.float64)
    for part in parts:
        error = load(part) - weights[part] @ atoms  # [m, C, D]
        for which, rest in enumerate((error, error - residual.T)):
            squares = rest.square().sum((1, 2), dtype=torch.float64)  # [m]
            own = squares if importance is None else squares * importance[part]
            total[which] += own.sum().cpu()
    without, with_residual = ranks.sum(total).tolist()
    return without, with_residual


def _dense(fit: Fit, atom_count: int) -> Tensor:
    """Weights of all atoms, `[n, C, J]`, mostly zeros."""
    weights = fit.weights.transpose(1, 2)  # [n, C, M], zero where padded
    dense = weights.new_zeros(*weights.shape[:2], atom_count)
    return dense.scatter_add_(2, fit.index.clamp(min=0)[:, None].expand_as(weights), weights)
