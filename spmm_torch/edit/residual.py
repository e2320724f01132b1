"""The residual of clusters under edits: a mask that cuts a cluster splits it.

A texel has one label, which cannot stand for a mix of two residuals. Where a mask is soft, the
texels of a cluster with about the same share (in STEPS steps) therefore form a cluster of their
own, which gets their mean share: exact for shares of 0 and 1, off by half a step at most between.
Components have a number a texel, so masks act on them as they are; see `components.py`.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from ..model.components import Components
from ..model.residual import Residual, decode_residual, encode_residual
from ..model.spmm import SPMM
from .components import mapped_components, scaled_components
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


@dataclass(frozen=True)
class WholeResidual:
    """All that the residual of a model is made of.

    Attributes:
        labels: cluster of each texel, `[T]`.
        residual: epsilon of each cluster.
        components: the residual of each texel; None for none.
    """

    labels: Tensor
    residual: Residual
    components: Components | None

    @classmethod
    def of(cls, model: SPMM) -> WholeResidual:
        """That of a model."""
        return cls(model.labels, model.residual, model.components)


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


def scaled_residual(model: SPMM, factor: float, where: Selection) -> WholeResidual:
    """The residual times `factor` where it is selected; codes of clusters stay, scales change."""
    whole = WholeResidual.of(model)
    if not where.reaches_residual:
        return whole
    components = whole.components and scaled_components(whole.components, factor, where.texels)
    labels, residual = _scaled_clusters(whole, factor, where.texels)
    return WholeResidual(labels, residual, components)


def mapped_residual(model: SPMM, matrix: Tensor, where: Selection) -> WholeResidual:
    """The residual, its colours multiplied by `matrix [C, C]` where it is selected."""
    whole = WholeResidual.of(model)
    if not where.reaches_residual:
        return whole
    components = whole.components and mapped_components(whole.components, matrix, where.texels)
    labels, residual = _mapped_clusters(whole, matrix, where.texels)
    return WholeResidual(labels, residual, components)


def _scaled_clusters(
    whole: WholeResidual, factor: float, share: Tensor | None
) -> tuple[Tensor, Residual]:
    """Labels `[T]` and residual of clusters times `factor`, by the share `[T]` of each texel."""
    residual = whole.residual
    if share is None or not len(residual.code):
        return whole.labels, residual.with_codes(residual.code, residual.scale * factor)
    parts = split_clusters(whole.labels, share)
    scale = residual.scale[parts.cluster]
    scale = torch.lerp(scale, scale * factor, parts.share.to(scale))
    return parts.label, residual.with_codes(residual.code[parts.cluster], scale)


def _mapped_clusters(
    whole: WholeResidual, matrix: Tensor, share: Tensor | None
) -> tuple[Tensor, Residual]:
    """Labels `[T]` and residual of clusters, colours times a matrix by the share of each texel.

    Parts of share 0 keep their bits.

    Args:
        whole: the residual.
        matrix: `[C, C]`.
        share: `[T]`; None for 1 everywhere.
    """
    residual = whole.residual
    code, scale = residual.code.detach(), residual.scale
    if share is None or not len(code):
        values = decode_residual(code, scale) @ matrix.to(scale).T
        return whole.labels, residual.with_codes(*encode_residual(values, code.dtype))
    parts = split_clusters(whole.labels, share)
    code, scale = code[parts.cluster], scale[parts.cluster]
    edited = torch.nonzero(parts.share > 0.0).squeeze(-1)
    values = decode_residual(code[edited], scale[edited])  # [E, V, L, C]
    weight = parts.share[edited].view(-1, 1, 1, 1).to(values)
    values = torch.lerp(values, values @ matrix.to(values).T, weight)
    code[edited], scale[edited] = encode_residual(values, code.dtype)
    return parts.label, residual.with_codes(code, scale)
