"""The model of a fit: the lobes in use, the entries of all texels, the residuals."""

from __future__ import annotations

import torch

from ..config.fit import StorageConfig
from ..data import BTF
from ..model.residual import Residual
from ..model.spmm import SPMM, SparseWeights
from ..model.stored_weights import rounded
from .cluster import Clusters
from .dictionary import Dictionary
from .select.clusters import ClusterFit
from .storage import weight_type


def assemble(
    btf: BTF,
    clusters: Clusters,
    dictionary: Dictionary,
    fits: list[ClusterFit],
    storage: StorageConfig,
) -> SPMM:
    """The model on the CPU [WDR11 Eq. 2], without lobes that no texel uses.

    Its weights are those that its file holds.
    """
    entries = _entries(clusters, fits)
    kind = weight_type(storage, entries, dictionary, fits)
    used, index = torch.unique(entries.index, return_inverse=True)
    views, lights = len(btf.view), len(btf.light)
    residual = Residual(
        torch.stack([fit.code.unflatten(0, (views, lights)) for fit in fits]),
        torch.stack([fit.scale for fit in fits]),
        btf.light,
        btf.view,
    )
    return SPMM(
        btf.height,
        btf.width,
        dictionary.lobes.to("cpu").detach()[used],
        rounded(SparseWeights(entries.offset, index, entries.weight), kind),
        clusters.labels,
        residual,
        btf.light,
        btf.view,
        btf.name,
        weight_type=kind,
    )


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
