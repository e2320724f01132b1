"""The residual at the hits of a picture; where it is interpolated is found once."""

from __future__ import annotations

import torch
from torch import Tensor

from ...model import SPMM


class ResidualCache:
    """epsilon_k of all hits under one light and view, as `Residual.forward` has it.

    Args:
        model: gives the measured directions, which no edit changes.
        texel: n texels of each of P hits, `[P, n]`.
        wi, wo: local directions, `[P, 3]`.
    """

    def __init__(self, model: SPMM, texel: Tensor, wi: Tensor, wo: Tensor) -> None:
        residual = model.residual
        light, light_weight = residual.light_mesh.to(wi.device).weights(wi)  # [P, 3]
        view, view_weight = residual.view_mesh.to(wo.device).weights(wo)  # [P, 3]
        pair = view[:, :, None] * len(model.light) + light[:, None, :]
        fade = (wi[:, 2] / residual.lowest_light).clamp(0.0, 1.0) * (wo[:, 2] > 0.0)
        weight = view_weight[:, :, None] * light_weight[:, None, :] * fade[:, None, None]
        self.texel, self.pair, self.weight = texel, pair.flatten(1), weight.flatten(1)  # [P, 9]
        self._kept: tuple[tuple[Tensor, ...], Tensor] | None = None

    @torch.no_grad()
    def values(self, model: SPMM) -> Tensor:
        """The residual of each texel of each hit, `[P, n, C]`."""
        source = (model.residual.code, model.residual.scale, model.labels)
        if self._kept is not None and all(map(_same_storage, self._kept[0], source)):
            return self._kept[1]
        code, scale, labels = source
        cluster = labels[self.texel]  # [P, n]
        flat = code.flatten(1, 2)  # [K, V * L, C]
        corners = flat[cluster[..., None], self.pair[:, None]].to(self.weight)  # [P, n, 9, C]
        value = torch.einsum("pnec,pe,pn->pnc", corners, self.weight, scale[cluster])
        self._kept = source, value
        return value


def _same_storage(a: Tensor, b: Tensor) -> bool:
    return a.data_ptr() == b.data_ptr() and a.shape == b.shape
