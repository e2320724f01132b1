"""The residual under edits: it is stored by cluster, so a mask that cuts a cluster splits it.

A texel has one label, which cannot stand for a mix of two residuals. Where a mask is soft, texels
of a cluster with about the same share (in STEPS steps) therefore form a cluster of their own, that
gets their mean share: exact for shares of 0 and 1, and off by half a step at the most between.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from ..model.residual import Residual, decode_residual, encode_residual
from ..model.spmm import SPMM
from .parts import check_factor, with_parts
from .selection import Selection

# Clusters that a soft edge makes of one, beside its edited and its unedited part: each takes as
# much storage as the residual of one cluster.
STEPS = 4


@dataclass(frozen=True)
class Groups:
    """Texels of equal cluster and about equal share.

    Attributes:
        label: group of each texel, `[T]`.
        cluster: where each group comes from, `[G]`.
        share: mean share of each group, `[G]`.
    """

    label: Tensor
    cluster: Tensor
    share: Tensor


def share_steps(share: Tensor) -> Tensor:
    """The step of each share `[T]`: 0 for 0, STEPS + 1 for 1, and 1 to STEPS between."""
    between = 1 + (share * STEPS).long().clamp(max=STEPS - 1)
    return torch.where(share == 0.0, 0, torch.where(share == 1.0, STEPS + 1, between))


def grouped(labels: Tensor, share: Tensor) -> Groups:
    """Splits clusters by the share of their texels: labels and share `[T]`.

    Clusters without texels vanish.
    """
    key = labels * (STEPS + 2) + share_steps(share)
    keys, label, count = torch.unique(key, return_inverse=True, return_counts=True)
    total = torch.zeros(len(keys), dtype=share.dtype, device=share.device)
    mean = total.index_add(0, label, share) / count
    return Groups(label, torch.div(keys, STEPS + 2, rounding_mode="floor"), mean)


def scaled(model: SPMM, factor: float, texels: Tensor | None) -> tuple[Tensor, Residual]:
    """Labels and residual times `factor`; codes stay as they are, only scales change.

    Args:
        texels: share of each texel `[T]`; None for all.
    """
    residual = model.residual
    if texels is None:
        return model.labels, residual.with_codes(residual.code, residual.scale * factor)
    groups = grouped(model.labels, texels)
    scale = residual.scale[groups.cluster]
    scale = torch.lerp(scale, scale * factor, groups.share.to(scale))
    return groups.label, residual.with_codes(residual.code[groups.cluster], scale)


def mapped(model: SPMM, matrix: Tensor, texels: Tensor | None) -> tuple[Tensor, Residual]:
    """Labels and residual with colours multiplied by `matrix [C, C]`; what is not edited keeps
    its bits.

    Args:
        texels: share of each texel `[T]`; None for all.
    """
    residual = model.residual
    code, scale = residual.code.detach(), residual.scale
    if texels is None:
        values = decode_residual(code, scale) @ matrix.to(scale).T
        return model.labels, residual.with_codes(*encode_residual(values, code.dtype))
    groups = grouped(model.labels, texels)
    code, scale = code[groups.cluster], scale[groups.cluster]
    edited = torch.nonzero(groups.share > 0.0).squeeze(-1)
    values = decode_residual(code[edited], scale[edited])  # [E, V, L, C]
    share = groups.share[edited].view(-1, 1, 1, 1).to(values)
    values = torch.lerp(values, values @ matrix.to(values).T, share)
    code[edited], scale[edited] = encode_residual(values, code.dtype)
    return groups.label, residual.with_codes(code, scale)


@torch.no_grad()
def residual_strength(model: SPMM, factor: float, where: Selection | None = None) -> SPMM:
    """The residual alone times `factor`; 0 leaves the bare lobes.

    The residual is what the fit could not explain of the measured look. After strong edits of
    lobes it may show ghosts of highlights that are no longer there: fade it then.

    Args:
        where: None for the whole texture.

    Raises:
        ConfigError: `factor` is negative or not finite.
    """
    check_factor("strength of the residual", factor)
    texels = None if where is None else where.texels
    if factor == 1.0 or (where is not None and texels is None):
        return model
    labels, residual = scaled(model, factor, texels)
    return with_parts(model, labels=labels, residual=residual)
