"""Slopes of a BRDF that does not tell them, by one backward pass for all pairs of its lobes.

f_r of a pair depends on its lobe only through kappa and through wi and wo in the frame of the lobe.
These are the leaves of the backward pass, one set for each pair, so one pass gives their gradients
at all pairs.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import cast

import torch
from torch import Tensor

from ..brdf import MAX_PARAMETERS, REGISTRY
from ..brdf.base import Vectors
from ..geometry.shapes import broadcast_shape


@dataclass(frozen=True)
class Recorded:
    """f_r of J lobes and its derivatives at all pairs.

    Attributes:
        value: f_r `[J, ...]`.
        kappa: along the parameters, P tensors `[J, ...]`.
        wi, wo: along the components of both directions, three tensors `[J, ...]` each.
    """

    value: Tensor
    kappa: tuple[Tensor, ...]
    wi: tuple[Tensor, ...]
    wo: tuple[Tensor, ...]


def record(model: int, kappa: tuple[Tensor, ...], wi: Vectors, wo: Vectors) -> Recorded:
    """f_r of lobes of one model and its derivatives.

    Args:
        model: index into `MODEL_NAMES`.
        kappa: P parameters `[J, 1, ...]`.
        wi, wo: local directions `[J, ..., 3]`, which broadcast.
    """
    shape = broadcast_shape(wi.shape[:-1], wo.shape[:-1])
    leaves = [
        part.detach().expand(shape).contiguous().requires_grad_()
        for part in (*wi.parts, *wo.parts, *kappa)
    ]
    padding = [torch.zeros_like(leaves[0])] * (MAX_PARAMETERS - len(kappa))
    with torch.enable_grad():
        parts = leaves[6:] + padding, leaves[:3], leaves[3:6]
        value = REGISTRY[model].eval(*(cast("Tensor", Vectors(tuple(part))) for part in parts))
        if value.requires_grad:
            found = torch.autograd.grad(
                value.sum(), leaves, allow_unused=True, materialize_grads=True
            )
        else:  # a constant
            found = tuple(torch.zeros_like(part) for part in leaves)
    return Recorded(value.detach(), found[6:], found[:3], found[3:6])
