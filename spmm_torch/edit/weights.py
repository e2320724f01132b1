"""Edits of the weights by a factor [WDR11 §5.1]."""

from __future__ import annotations

import torch
from torch import Tensor

from ..lobes.sampling import SPECULAR_WIDTH
from ..model.spmm import SPMM, SparseWeights
from . import residual as residuals
from .groups import edited_texels, entry_share, lobe_group
from .parts import check_factor, with_parts
from .selection import Selection


@torch.no_grad()
def intensity(
    model: SPMM,
    factor: float,
    where: Selection | None = None,
    group: str = "all",
    threshold: float = SPECULAR_WIDTH,
) -> SPMM:
    """All weights times `factor` [WDR11 §5.1, overall intensity and specular intensity].

    The residual of what is edited is multiplied too, so that the whole look is, exactly; but where
    only a group of lobes is edited, or lobes are selected by a property, it stays as it is.

    Args:
        factor: not below 0.
        where: None for the whole texture.
        group: `all`, `specular` or `non_specular` lobes.
        threshold: width in radians under which a lobe is specular.

    Raises:
        ConfigError: a factor or group that is not valid, or a group without lobes.
    """
    check_factor("factor on the intensity", factor)
    lobes = lobe_group(model, group, threshold)
    if factor == 1.0:
        return model
    share = entry_share(model, lobes, where)
    weight = scaled_weight(model.weight, factor, share)
    labels, residual = model.labels, model.residual
    reaches, texels = edited_texels(lobes, where)
    if reaches:
        labels, residual = residuals.scaled(model, factor, texels)
    weights = SparseWeights(model.offset, model.index, weight)
    return with_parts(model, weights=weights, labels=labels, residual=residual)


def scaled_weight(weight: Tensor, factor: float, share: Tensor | None) -> Tensor:
    """Weights `[N, C]` times `factor`, or times 1 + share (factor - 1) with share `[N]`."""
    if share is None:
        return weight * factor
    return weight * torch.lerp(torch.ones_like(share), share.new_tensor(factor), share)[:, None]
