"""The number format of the weights in the model file, by what its rounding costs."""

from __future__ import annotations

import math

import torch

from ..config.fit import StorageConfig
from ..metrics import Totals
from ..model.lookup import SparseWeights
from ..model.stored_weights import WEIGHT_TYPES, rounding_energy
from .dictionary import Dictionary
from .select.clusters import ClusterFit

MAX_COST_DB = 0.02  # of the lobes alone and of the whole model


def weight_type(
    storage: StorageConfig, weights: SparseWeights, dictionary: Dictionary, fits: list[ClusterFit]
) -> torch.dtype:
    """The number format of the weights: that of the settings, or the smallest that is good enough.

    Args:
        storage: settings.
        weights: entries of all texels, lobes of the dictionary.
        dictionary: J lobes.
        fits: of all clusters.
    """
    if storage.weights != "auto":
        return WEIGHT_TYPES[storage.weights]
    energy = (dictionary.raw.square().sum(1) * dictionary.norm.square()).cpu()  # [J]
    totals = Totals.sum(fit.totals for fit in fits)
    cheap = (
        kind
        for kind in WEIGHT_TYPES.values()
        if cost_db(totals, rounding_energy(weights, kind, energy)) <= MAX_COST_DB
    )
    return next(cheap)  # float32 costs nothing


def cost_db(totals: Totals, added: float) -> float:
    """How much SNR squared errors `added` to those of a fit cost, at the worse of both errors."""
    if added <= 0.0:
        return 0.0
    least = min(totals.without_residual, totals.with_residual)
    return math.inf if least <= 0.0 else 10.0 * math.log10(1.0 + added / least)
