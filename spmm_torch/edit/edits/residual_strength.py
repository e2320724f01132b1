"""The residual stronger, weaker, or off."""

from __future__ import annotations

from dataclasses import dataclass

import torch

from ...config.schema import setting
from ...model.spmm import SPMM
from ..options import MAX_FACTOR, check_factor
from ..parts import with_parts
from ..residual import scaled_residual
from ..selection import EVERYTHING, Selection


@dataclass(frozen=True)
class ResidualStrength:
    """The residual stronger, weaker, or off."""

    factor: float = setting(1.0, "factor on the residual", low=0.0, high=MAX_FACTOR)

    def apply(self, model: SPMM, where: Selection) -> SPMM:
        """The edited model."""
        return residual_strength(model, self.factor, where)


@torch.no_grad()
def residual_strength(model: SPMM, factor: float, where: Selection = EVERYTHING) -> SPMM:
    """The residual alone times `factor`; 0 leaves the bare lobes.

    The residual is what the fit could not explain of the measured look. After strong edits of
    lobes it may show ghosts of old highlights: fade it then.

    Args:
        model: the original.
        factor: not below 0.
        where: what is edited; nothing where only some lobes are selected.

    Raises:
        ConfigError: the factor is negative or not finite.
    """
    check_factor("strength of the residual", factor)
    if factor == 1.0 or not where.reaches_residual:
        return model
    whole = scaled_residual(model, factor, where)
    return with_parts(model, **vars(whole))
