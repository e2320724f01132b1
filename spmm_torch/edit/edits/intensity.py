"""Brighter or darker: weights times a factor [WDR11 §5.1]."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from ...config.schema import setting
from ...model.lookup import SparseWeights
from ...model.spmm import SPMM
from ..groups import group_setting, lobe_group, threshold_setting
from ..options import MAX_FACTOR, check_factor
from ..parts import with_parts
from ..residual import scaled_residual
from ..selection import EVERYTHING, Selection


@dataclass(frozen=True)
class Intensity:
    """Brighter or darker."""

    factor: float = setting(1.0, "factor on the weights", low=0.0, high=MAX_FACTOR)
    group: str = group_setting()
    threshold: float = threshold_setting()

    def apply(self, model: SPMM, where: Selection) -> SPMM:
        """The edited model."""
        where = where & lobe_group(model, self.group, self.threshold)
        return intensity(model, self.factor, where)


@torch.no_grad()
def intensity(model: SPMM, factor: float, where: Selection = EVERYTHING) -> SPMM:
    """All weights times `factor` [WDR11 §5.1, overall intensity and specular intensity].

    The residual of whole texels is multiplied too, so their look is, exactly. It stays where only
    some lobes are selected.

    Args:
        model: the original.
        factor: not below 0.
        where: what is edited.

    Raises:
        ConfigError: the factor is negative or not finite.
    """
    check_factor("factor on the intensity", factor)
    if factor == 1.0:
        return model
    weight = _scaled_weight(model.weight, factor, where.entry_share(model))
    whole = scaled_residual(model, factor, where)
    weights = SparseWeights(model.offset, model.index, weight)
    return with_parts(model, weights=weights, **vars(whole))


def _scaled_weight(weight: Tensor, factor: float, share: Tensor | None) -> Tensor:
    """Weights `[N, C]` times `factor`, or times 1 + share (factor - 1) with share `[N]`."""
    if share is None:
        return weight * factor
    return weight * torch.lerp(torch.ones_like(share), share.new_tensor(factor), share)[:, None]
