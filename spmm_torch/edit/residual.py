"""The residual under edits: it is stored by cluster, so a mask that cuts a cluster splits it.

A texel has one label, which cannot stand for a mix of two residuals. Where a mask is soft, the
texels of a cluster with about the same share (in STEPS steps) therefore form a cluster of their
own, which gets their mean share: exact for shares of 0 and 1, off by half a step at most between.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from ..model.residual import Residual, decode_residual, encode_residual
from ..model.spmm import SPMM
from .selection import Selection

# Clusters that a soft edge makes of one, beside its edited and its unedited part: each takes as
# much storage as the residual of one cluster.
STEPS = 4


@dataclass(frozen=True)
class ClusterParts:
    """G parts of clusters: texels of equal cluster and about equal share.

    Attributes:
        label: part of each texel, `[T]`.
        cluster: cluster of each part, `[G]`.
        share: mean share of each part, `[G]`.
    """

    label: Tensor
    cluster: Tensor
    share: Tensor


def share_steps(share: Tensor) -> Tensor:
    """The step of each share `[T]`: 0 for 0, STEPS + 1 for 1, and 1 to STEPS between."""
    between = 1 + (share * STEPS).long().clamp(max=STEPS - 1)
    return torch.where(share == 0.0, 0, torch.where(share == 1.0, STEPS + 1, between))


def split_clusters(labels: Tensor, share: Tensor) -> ClusterParts:
    """Splits clusters by the share of their texels; clusters without texels vanish.

    Args:
        labels: cluster of each texel, `[T]`.
        share: of each texel, `[T]`.
    """
    key = labels * (STEPS + 2) + share_steps(share)
    keys, label, count = torch.unique(key, return_inverse=True, return_counts=True)
    total = torch.zeros(len(keys), dtype=share.dtype, device=share.device)
    mean = total.index_add(0, label, share) / count
    return ClusterParts(label, torch.div(keys, STEPS + 2, rounding_mode="floor"), mean)


def scaled_residual(model: SPMM, factor: float, where: Selection) -> tuple[Tensor, Residual]:
    """Labels `[T]` and residual times `factor` where it is selected; codes stay, scales change."""
    residual = model.residual
    if not where.reaches_residual:
        return model.labels, residual
    if where.texels is None:
        return model.labels, residual.with_codes(residual.code, residual.scale * factor)
    parts = split_clusters(model.labels, where.texels)
    scale = residual.scale[parts.cluster]
    scale = torch.lerp(scale, scale * factor, parts.share.to(scale))
    return parts.label, residual.with_codes(residual.code[parts.cluster], scale)


def mapped_residual(model: SPMM, matrix: Tensor, where: Selection) -> tuple[Tensor, Residual]:
    """Labels `[T]` and residual, its colours multiplied by `matrix [C, C]` where it is selected.

    Parts of share 0 keep their bits.
    """
    residual = model.residual
    if not where.reaches_residual:
        return model.labels, residual
    code, scale = residual.code.detach(), residual.scale
    if where.texels is None:
        values = decode_residual(code, scale) @ matrix.to(scale).T
        return model.labels, residual.with_codes(*encode_residual(values, code.dtype))
    parts = split_clusters(model.labels, where.texels)
    code, scale = code[parts.cluster], scale[parts.cluster]
    edited = torch.nonzero(parts.share > 0.0).squeeze(-1)
    values = decode_residual(code[edited], scale[edited])  # [E, V, L, C]
    share = parts.share[edited].view(-1, 1, 1, 1).to(values)
    values = torch.lerp(values, values @ matrix.to(values).T, share)
    code[edited], scale[edited] = encode_residual(values, code.dtype)
    return parts.label, residual.with_codes(code, scale)
