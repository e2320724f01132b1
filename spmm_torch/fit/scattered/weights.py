"""Weights of the pairs of a list: compressed errors count by the volume of pairs of directions.

Samples may lie where they will, such as a hundred times as densely about a highlight. Errors of
cube roots are to see the whole of the material, so that each sample has the volume that it has for
itself among the pairs of directions; squared errors are those of the samples as they are.
"""

from __future__ import annotations

import torch
from torch import Tensor

from ...data.error_weights import Weights
from ...data.pair_lists import PairedBTF
from ...geometry.neighbours import nearest
from ..glossy.objective import Objective
from ..weighting.compressive import compressive_weights

# Neighbours that tell how densely samples lie: more are less noisy, and reach farther.
NEIGHBOURS = 8
# Pairs of directions are points of so many dimensions.
DIMENSIONS = 4
# Greatest volume of a sample, over the median: one that is alone does not rule the fit.
MOST_VOLUME = 100.0


def list_weights(
    btf: PairedBTF, objective: Objective, device: torch.device, chance: Tensor | None = None
) -> Weights:
    """The weights of a fit to the texels of a list.

    Args:
        btf: the texels, at all pairs of the list or at some.
        objective: what is minimized.
        device: of the computation.
        chance: inverse of the chance by which each pair was drawn, `[D]`; None: all are there.
    """
    weights = compressive_weights(btf, objective, device)
    if not objective.plain:  # volumes are those among the pairs that were drawn
        return weights.times(Weights.build(btf, volumes(*btf.pairs())[None]))
    return weights if chance is None else weights.times(Weights.build(btf, chance[None]))


def volumes(wi: Tensor, wo: Tensor) -> Tensor:
    """The volume `[D]` float64 that each pair has for itself, up to a factor.

    It grows with the distance to the 8th neighbour; the squared distance of two pairs is that of
    their lights plus that of their views.

    Args:
        wi, wo: directions `[D, 3]`, of which no two pairs are the same.
    """
    pairs = torch.cat((wi, wo), dim=1)
    count = min(NEIGHBOURS + 1, len(pairs))  # with itself
    if count < 2:
        return torch.ones(len(pairs), dtype=torch.float64)
    distance = nearest(pairs, pairs, count)[0][:, -1]
    volume = distance**DIMENSIONS
    return volume.clamp(max=MOST_VOLUME * float(volume.median()))
