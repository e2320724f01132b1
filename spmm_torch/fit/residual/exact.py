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

from ...model.residual import decode_residual
from ...runtime.ranks import ALONE, Ranks
from ..select.products import Load
from ..select.texels import Fit
from .errors import ClusterErrors

# Relative error under which one more pass is made: rounding is 1 % of the error there.
DOUBTFUL = 1e-5


def is_doubtful(error: float, energy: float) -> bool:
    """Whether a squared error from products may be rounding."""
    return error < DOUBTFUL * energy


def exact_where_doubtful(
    errors: ClusterErrors,
    passes: tuple[Load, Sequence[slice]],
    fits: Sequence[Fit],
    atoms: Tensor,
    ranks: Ranks = ALONE,
) -> ClusterErrors:
    """The errors of a cluster, by one more pass where they may be rounding.

    Args:
        errors: from products.
        passes: load and parts, as in `exact_errors`.
        fits, ranks: as in `exact_errors`.
        atoms: `[J, D]`, of unit norm.
    """
    totals = errors.totals
    if not is_doubtful(min(totals.without_residual, totals.with_residual), totals.energy):
        return errors
    residual = decode_residual(errors.code[None], errors.scale[None])[0].to(atoms.device)
    without, with_residual = exact_errors(*passes, fits, atoms, residual, ranks)
    totals = replace(totals, without_residual=without, with_residual=with_residual)
    return replace(errors, totals=totals)


def exact_errors(
    load: Load,
    parts: Sequence[slice],
    fits: Sequence[Fit],
    atoms: Tensor,
    residual: Tensor,
    ranks: Ranks = ALONE,
) -> tuple[float, float]:
    """Squared errors of a whole cluster (without its residual, with it), from the values.

    Args:
        load: gives the values `[m, C, D]` of some of the n texels of this rank.
        parts: blocks of the n texels.
        fits: of the n texels, in their order.
        atoms: `[J, D]`, of unit norm.
        residual: the stored values, `[D, C]`.
        ranks: processes among which the cluster is divided.
    """
    none = atoms.new_zeros(0, residual.shape[1], len(atoms))  # a rank may have no texels
    weights = torch.cat([none, *(_dense(fit, len(atoms)) for fit in fits)])  # [n, C, J]
    total = torch.zeros(2, dtype=torch.float64)
    for part in parts:
        error = load(part) - weights[part] @ atoms  # [m, C, D]
        for which, rest in enumerate((error, error - residual.T)):
            total[which] += rest.square().sum(dtype=torch.float64).cpu()
    without, with_residual = ranks.sum(total).tolist()
    return without, with_residual


def _dense(fit: Fit, atom_count: int) -> Tensor:
    """Weights of all atoms, `[n, C, J]`, mostly zeros."""
    weights = fit.weights.transpose(1, 2)  # [n, C, M], zero where padded
    dense = weights.new_zeros(*weights.shape[:2], atom_count)
    return dense.scatter_add_(2, fit.index.clamp(min=0)[:, None].expand_as(weights), weights)
