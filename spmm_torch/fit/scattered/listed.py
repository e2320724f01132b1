"""The fit of the texels of a list of pairs."""

from __future__ import annotations

from dataclasses import dataclass, replace

from torch import Tensor

from ...config.fit import SelectConfig
from ...metrics import Totals
from ...solvers.status import StatusCounts

# Samples of a texel for each of its lobes, at least: fewer would be fit as they come.
SAMPLES_A_LOBE = 4


@dataclass(frozen=True)
class ListFit:
    """The fit of the n texels of a list, or of several short ones.

    Attributes:
        texels: their indices, `[n]`.
        index: lobes `[n, M]`, -1 for padding.
        weights: alpha `[n, M, C]`.
        weighted: squared errors of the lobes by the weights of the fit.
        solvers: problems solved, by solver and status.
    """

    texels: Tensor
    index: Tensor
    weights: Tensor
    weighted: Totals
    solvers: StatusCounts


def limited(config: SelectConfig, pairs: int) -> SelectConfig:
    """The settings with no more lobes than so many pairs of a texel tell."""
    most = max(1, pairs // SAMPLES_A_LOBE)
    return replace(config, max_lobes=min(most, config.max_lobes or most))
