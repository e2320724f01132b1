"""The problem of a fit: measured values, weights of errors, settings, context of the run."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from ..config.fit import FitConfig
from ..data import BTF
from ..data.error_weights import Index, Weights
from ..data.pair_lists import PairedBTF
from ..geometry.directions import REPEAT
from ..geometry.relief import HeightField
from ..lobes.grid import DirectionGrid
from ..model.relief import Relief
from ..runtime.context import Context
from .glossy.compression import Compression
from .glossy.objective import PLAIN, Objective


@dataclass(frozen=True)
class Problem:
    """Find the mixture [WDR11 Eq. 2] of least weighted squared error on the measured values.

    Attributes:
        btf: the measured values, aligned so that all views show the same surface point.
        weights: of the errors, by texel and direction pair.
        config: the settings.
        context: of the run.
        pictures: the values as they were measured; the same where the surface is flat.
        objective: what is minimized.
        relief: of the surface that they show; None: it is flat.
        unit: power of two by which the values of the input were multiplied.
        compression: of the values whose errors count; None: they are as they are.
    """

    btf: BTF
    weights: Weights
    config: FitConfig
    context: Context
    pictures: BTF
    objective: Objective = PLAIN
    relief: Relief | None = None
    unit: float = 1.0
    compression: Compression | None = None

    @classmethod
    def build(
        cls,
        btf: BTF,
        weights: Weights,
        config: FitConfig,
        context: Context,
        objective: Objective = PLAIN,
        unit: float = 1.0,
        compression: Compression | None = None,
    ) -> Problem:
        """The problem of a flat surface."""
        return cls(
            btf, weights, config, context, btf, objective, unit=unit, compression=compression
        )

    def through(self, relief: Relief) -> Problem:
        """The problem of pictures that show a relief."""
        found = replace(self, relief=relief)
        return replace(found, btf=self.pictures.aligned(found.field(), relief.drift))

    def field(self) -> HeightField:
        """Heights of the surface that the pictures show."""
        size = (self.pictures.height, self.pictures.width)
        if self.relief is None:
            return HeightField(torch.zeros(size), REPEAT, slope=1.0)
        return self.relief.field(*size, self.pictures.view)

    @property
    def device(self) -> torch.device:
        """Device of the run."""
        return self.context.device

    def grid(self) -> DirectionGrid:
        """The measured direction pairs, scaled by the square roots of their weights."""
        scale = self.weights.scale(self.device)
        horizon = math.radians(self.config.dictionary.horizon)
        if isinstance(self.btf, PairedBTF):
            return DirectionGrid.of_pairs(*self.btf.pairs(), self.device, scale, horizon)
        return DirectionGrid.build(self.btf.light, self.btf.view, self.device, scale, horizon)

    def values(self, texels: Index) -> Tensor:
        """Values `[n, D, C]` of some texels times the square roots of the weights of the pairs."""
        return self.weights.values(self.btf, texels, self.device)

    def signals(self, texels: Index) -> Tensor:
        """Values `[n, C, D]` of some texels times the square roots of the weights of the pairs."""
        return self.weights.signals(self.btf, texels, self.device)

    def importance(self, texels: Index) -> Tensor | None:
        """Weights `[n]` of some texels; None if all are 1."""
        return self.weights.of_texels(texels, self.device)
