"""The mixtures that the fits of all clusters make: lobes in use, and entries of all texels."""

from __future__ import annotations

from dataclasses import dataclass

import torch

from ..lobes.batch import LobeBatch
from ..model.lookup import SparseWeights
from .cluster import Clusters
from .dictionary import Dictionary
from .select.clusters import ClusterFit


@dataclass(frozen=True)
class Mixtures:
    """The lobes in use and what every texel takes of them.

    Attributes:
        lobes: J lobes.
        entries: of all texels.
    """

    lobes: LobeBatch
    entries: SparseWeights


def mix(clusters: Clusters, dictionary: Dictionary, fits: list[ClusterFit]) -> Mixtures:
    """The mixtures of all texels on the CPU, without lobes that no texel uses."""
    entries = _entries(clusters, fits)
    used, index = torch.unique(entries.index, return_inverse=True)
    lobes = dictionary.lobes.to("cpu").detach()[used]
    return Mixtures(lobes, SparseWeights(entries.offset, index, entries.weight))


def _entries(clusters: Clusters, fits: list[ClusterFit]) -> SparseWeights:
    """Entries of all texels in the order of the texels, without padding."""
    texels, index, weight = [], [], []
    for members, fit in zip(clusters.members, fits, strict=True):
        real = fit.index >= 0  # [n, M]
        texels.append(members[:, None].expand(real.shape)[real])
        index.append(fit.index[real])
        weight.append(fit.weights[real])
    texel = torch.cat(texels)
    order = torch.argsort(texel, stable=True)
    count = torch.bincount(texel, minlength=len(clusters.labels))
    offset = torch.cat((count.new_zeros(1), count.cumsum(0)))
    return SparseWeights(offset, torch.cat(index)[order], torch.cat(weight)[order])
