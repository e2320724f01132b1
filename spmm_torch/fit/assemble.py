"""The model of a fit: the lobes in use, the entries of all texels, the residuals."""

from __future__ import annotations

import torch

from ..data import BTF
from ..lobes.batch import LobeBatch
from ..model.residual import Residual
from ..model.spmm import SPMM, SparseWeights
from .cluster import Clusters
from .select.clusters import ClusterFit


def assemble(btf: BTF, clusters: Clusters, lobes: LobeBatch, fits: list[ClusterFit]) -> SPMM:
    """The model on the CPU [WDR11 Eq. 2], without lobes that no texel uses."""
    entries = _entries(clusters, fits)
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
        lobes.to("cpu").detach()[used],
        SparseWeights(entries.offset, index, entries.weight),
        clusters.labels,
        residual,
        btf.light,
        btf.view,
        btf.name,
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
