"""The problem of a fit: measured values, weights of errors, settings, context of the run."""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor

from ..config.fit import FitConfig
from ..data import BTF
from ..data.error_weights import Index, Weights
from ..lobes.grid import DirectionGrid
from ..runtime.context import Context


@dataclass(frozen=True)
class Problem:
    """Find the mixture [WDR11 Eq. 2] of least weighted squared error on the measured values.

    Attributes:
        btf: the measured values.
        weights: of the errors, by texel and direction pair.
        config: the settings.
        context: of the run.
    """

    btf: BTF
    weights: Weights
    config: FitConfig
    context: Context

    @property
    def device(self) -> torch.device:
        """Device of the run."""
        return self.context.device

    def grid(self) -> DirectionGrid:
        """The measured direction pairs, scaled by the square roots of their weights."""
        scale = self.weights.scale(self.device)
        horizon = math.radians(self.config.dictionary.horizon)
        return DirectionGrid.build(self.btf.light, self.btf.view, self.device, scale, horizon)

    def signals(self, texels: Index) -> Tensor:
        """Values `[n, C, D]` of some texels times the square roots of the weights of the pairs."""
        return self.weights.signals(self.btf, texels, self.device)

    def importance(self, texels: Index) -> Tensor | None:
        """Weights `[n]` of some texels; None if all are 1."""
        return self.weights.of_texels(texels, self.device)
