"""A model with some of its parts replaced."""

from __future__ import annotations

import torch
from torch import Tensor

from ..lobes.batch import LobeBatch
from ..model.components import Components
from ..model.lookup import SparseWeights
from ..model.relief import Relief
from ..model.residual import Residual
from ..model.spmm import SPMM


def with_parts(
    model: SPMM,
    *,
    lobes: LobeBatch | None = None,
    weights: SparseWeights | None = None,
    labels: Tensor | None = None,
    residual: Residual | None = None,
    components: Components | None = None,
    relief: Relief | None = None,
) -> SPMM:
    """A model with the given parts, which shares the tensors of all others with `model`.

    Args:
        model: the original.
        lobes: the dictionary.
        weights: entries of all texels.
        labels: cluster of each texel, `[T]`.
        residual: epsilon of each cluster.
        components: the residual of each texel.
        relief: heights of the surface.
    """
    kind = model.weight_type
    if weights is not None and kind == torch.uint8:
        kind = torch.int16  # other weights change the range, and one byte would round all anew
    return SPMM(
        model.height,
        model.width,
        (model.dictionary if lobes is None else lobes).detach(),
        weights or model.sparse_weights,
        model.labels if labels is None else labels,
        residual or model.residual,
        model.light,
        model.view,
        model.name,
        components=components or model.components,
        weight_type=kind,
        relief=relief or model.relief,
    )


def flattened(model: SPMM) -> SPMM:
    """The model without its relief: views see the texture in its plane, which goes on as before.

    Its measured pictures lie where they lay: their drift stays.
    """
    drift = None if model.relief is None else model.relief.drift
    flat = Relief(None, 0.0, 0.0, model.rule, drift)
    return with_parts(model, relief=flat.to(model.weight.device))
