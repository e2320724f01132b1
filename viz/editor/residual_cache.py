"""The residual at the hits of a picture, kept while edits change other things."""

from __future__ import annotations

import torch
from torch import Tensor

from ...model.spmm import SPMM


class ResidualCache:
    """The whole residual of all hits under one light and view.

    Args:
        texel, texel_weight: n texels of each of P hits and their weights, `[P, n]`.
        wi, wo: local directions, `[P, 3]`.
    """

    def __init__(self, texel: Tensor, texel_weight: Tensor, wi: Tensor, wo: Tensor) -> None:
        self.texel, self.texel_weight, self.wi, self.wo = texel, texel_weight, wi, wo
        self._kept: tuple[tuple[Tensor, ...], Tensor] | None = None

    @torch.no_grad()
    def values(self, model: SPMM) -> Tensor:
        """The residual of each hit, `[P, C]`."""
        source = _source(model)
        if self._kept is None or not _same(self._kept[0], source):
            value = model.epsilon(self.texel, self.texel_weight, self.wi, self.wo)
            self._kept = source, value
        return self._kept[1]


def _source(model: SPMM) -> tuple[Tensor, ...]:
    """The tensors that the residual of a model is made of."""
    source = (model.residual.code, model.residual.scale, model.labels)
    if model.components is None:
        return source
    parts = model.components
    return (*source, parts.code, parts.scale, parts.coefficient, parts.coefficient_scale)


def _same(one: tuple[Tensor, ...], two: tuple[Tensor, ...]) -> bool:
    """Whether tensors share their storage, pair by pair."""
    return len(one) == len(two) and all(
        a.data_ptr() == b.data_ptr() and a.shape == b.shape for a, b in zip(one, two, strict=True)
    )
