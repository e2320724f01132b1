"""The relief flatter or deeper; beyond the paper."""

from __future__ import annotations

from dataclasses import dataclass

import torch

from ...config.schema import setting
from ...errors import ConfigError
from ...model.spmm import SPMM
from ..options import check_factor
from ..parts import with_parts
from ..selection import EVERYTHING, Selection

# Largest factor in a script: reliefs are some hundredths of the texture deep.
MAX_DEPTH = 5.0


@dataclass(frozen=True)
class ReliefDepth:
    """The relief flatter or deeper."""

    factor: float = setting(1.0, "factor on heights about their mean", low=0.0, high=MAX_DEPTH)

    def apply(self, model: SPMM, where: Selection) -> SPMM:
        """The edited model."""
        return relief_depth(model, self.factor, where)


@torch.no_grad()
def relief_depth(model: SPMM, factor: float, where: Selection = EVERYTHING) -> SPMM:
    """Heights times `factor` about the mean height of the texture; 0 leaves its mean plane.

    The mean plane stays, so that the texture does not slide as a whole under oblique views.

    Args:
        model: the original.
        factor: not below 0.
        where: whole texels; shares soften the change.

    Raises:
        ConfigError: the factor is negative or not finite, the model has no relief, heights get out
            of their range, or some lobes of a texel are selected and others are not.
    """
    check_factor("factor on the relief", factor)
    if factor == 1.0:
        return model
    if model.relief is None:
        raise ConfigError(
            "the model has no relief; expected one to make deeper or flatter; fit it with a relief."
        )
    share = where.texel_share(model, "the depth of a relief")
    height = model.relief.heights(model.texel_count)
    mean = height.double().mean().to(height)
    scaled = mean + (height - mean) * (1.0 + share * (factor - 1.0))
    try:
        return with_parts(model, relief=model.relief.with_heights(scaled))
    except ValueError as error:
        raise ConfigError(f"a relief {factor:g} times as deep has {error}; lower it.") from error
