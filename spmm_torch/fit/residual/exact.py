"""Errors of fits that are too good for the Gram algebra, from the values themselves.

Errors in dictionary space are small differences of numbers as large as the energy, which float32
products hold to 1e-7: beyond 60 dB they tell rounding, not the model. There one more pass over
the texels tells the truth; float32 differences of values and model hold to 130 dB and more.
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
from .errors import Tally

# Share of the energy under which an error is passed over once more: rounding is 1 % of it there.
DOUBTFUL = 1e-5


def is_doubtful(error: float, energy: float) -> bool:
    """Whether an error from the Gram algebra may be rounding."""
    return error < DOUBTFUL * energy


def exact_where_doubtful(
    tally: Tally,
    passes: tuple[Load, Sequence[slice]],
    fits: Sequence[Fit],
    atoms: Tensor,
    ranks: Ranks = ALONE,
) -> Tally:
    """The tally, by one more pass where its errors may be rounding.

    Args:
        tally: of the whole cluster.
        passes: load and parts of `exact_errors`.
        fits, atoms, ranks: of `exact_errors`.
    """
    totals = tally.totals
    if not is_doubtful(min(totals.without_residual, totals.with_residual), totals.energy):
        return tally
    residual = decode_residual(tally.code[None], tally.scale[None])[0].to(atoms.device)
    without, with_residual = exact_errors(*passes, fits, atoms, residual, ranks)
    totals = replace(totals, without_residual=without, with_residual=with_residual)
    return replace(tally, totals=totals)


def exact_errors(
    load: Load,
    parts: Sequence[slice],
    fits: Sequence[Fit],
    atoms: Tensor,
    residual: Tensor,
    ranks: Ranks = ALONE,
) -> tuple[float, float]:
    """Squared errors of a whole cluster, without and with its residual.

    Args:
        load: gives the values `[m, C, D]` of some of this rank's n texels.
        parts: blocks that cover them.
        fits: of the n texels, one after the other.
        atoms: `[J, D]`, of unit norm.
        residual: as it is stored, `[D, C]`.
        ranks: that share the cluster.
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


def _dense(fit: Fit, atoms: int) -> Tensor:
    """Weights of all atoms, `[n, C, J]`."""
    weights = fit.weights.transpose(1, 2)  # [n, C, M], zero where padded
    dense = weights.new_zeros(*weights.shape[:2], atoms)
    return dense.scatter_add_(2, fit.index.clamp(min=0)[:, None].expand_as(weights), weights)
