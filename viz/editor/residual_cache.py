"""The residual at the hits of a picture, kept while edits change other things."""

from __future__ import annotations

import torch
from torch import Tensor

from ...model.spmm import SPMM


class ResidualCache:
    """epsilon_k of all hits under one light and view.

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
        source = (model.residual.code, model.residual.scale, model.labels)
        if self._kept is None or not all(map(_same_storage, self._kept[0], source)):
            cluster = model.labels[self.texel]
            value = model.residual.blend(cluster, self.texel_weight, self.wi, self.wo)
            self._kept = source, value
        return self._kept[1]


def _same_storage(a: Tensor, b: Tensor) -> bool:
    return a.data_ptr() == b.data_ptr() and a.shape == b.shape
