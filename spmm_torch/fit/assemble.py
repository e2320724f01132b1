"""The model of a fit: the lobes in use, the entries of all texels, the residuals."""

from __future__ import annotations

import torch

from ..model.components import Components
from ..model.lookup import SparseWeights
from ..model.residual import Residual
from ..model.spmm import SPMM
from .cluster import Clusters
from .mixtures import Mixtures
from .problem import Problem
from .refit.stage import Refit


def assemble(problem: Problem, clusters: Clusters, found: Mixtures, refit: Refit) -> SPMM:
    """The model on the CPU [WDR11 Eq. 2], in the unit of the input."""
    btf, unit = problem.pictures, problem.unit
    components = None
    if refit.components is not None:
        found_parts = refit.components
        components = Components(
            found_parts.code.cpu(),
            found_parts.scale.cpu() / unit,
            found_parts.coefficient.cpu(),
            found_parts.coefficient_scale.cpu(),
            btf.light,
            btf.view,
        )
    empty = torch.zeros(0, len(btf.view), len(btf.light), btf.channels, dtype=torch.float16)
    code, scale = refit.clusters or (empty, torch.zeros(0))
    entries = refit.entries
    return SPMM(
        btf.height,
        btf.width,
        found.lobes,
        SparseWeights(entries.offset.cpu(), entries.index.cpu(), entries.weight.cpu() / unit),
        clusters.labels,
        Residual(code, scale / unit, btf.light, btf.view),
        btf.light,
        btf.view,
        btf.name,
        components=components,
        relief=problem.relief,
        weight_type=refit.weight_type,
    )
