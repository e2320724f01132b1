"""What the stages of one fit share: measured values, weights of errors, settings, and the run."""

from __future__ import annotations

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
    """Find the mixture whose weighted errors on the measured values are least [WDR11 Eq. 2].

    Attributes:
        btf: the measured values.
        weights: how much an error counts, by texel and direction pair.
        config: the settings.
        context: the run.
    """

    btf: BTF
    weights: Weights
    config: FitConfig
    context: Context

    @property
    def device(self) -> torch.device:
        """On which to work."""
        return self.context.device

    def grid(self) -> DirectionGrid:
        """The measured direction pairs, scaled as their weights say."""
        scale = self.weights.scale(self.device)
        return DirectionGrid.build(self.btf.light, self.btf.view, self.device, scale)

    def signals(self, texels: Index) -> Tensor:
        """Weighted values `[n, C, D]` of some texels."""
        return self.weights.signals(self.btf, texels, self.device)

    def importance(self, texels: Index) -> Tensor | None:
        """Weights `[n]` of some texels; None if they are all 1."""
        return self.weights.of_texels(texels, self.device)
