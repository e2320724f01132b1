"""What the stages of a fit give, and one of several fits that were made apart."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import reduce
from typing import Any

import torch
from torch import Tensor

from ..data import BTF
from ..lobes.batch import LobeBatch
from ..metrics import Totals
from ..model.components import Components
from ..model.lookup import SparseWeights
from ..model.residual import Residual
from ..model.spmm import SPMM
from ..model.stored_weights import are_within, rounded
from ..report.contract import Ablation, ObjectiveFigures
from ..solvers.status import StatusCounts
from .glossy.objective import Objective


@dataclass(frozen=True)
class Solved:
    """A model and what is known of its fit.

    Attributes:
        model: the mixture model, on the CPU.
        totals: squared errors over all measured values.
        weighted: the same by the weights of the fit; None where these are all 1.
        objectives: what was minimized, in each of the parts that were fit apart.
        starts: of the search, `[3]`; see `FoundLobes.starts`.
        solvers: problems solved, by solver and status.
        samples: texels that were searched, `[S]`.
        lobes_found: their number, repeats included.
        ablation: SNR without each BRDF.
        auto: the choice of `--auto`; None without it.
    """

    model: SPMM
    totals: Totals
    weighted: Totals | None
    objectives: tuple[Objective, ...]
    starts: Tensor
    solvers: StatusCounts
    samples: Tensor
    lobes_found: int
    ablation: Ablation = Ablation()
    auto: dict[str, Any] | None = None

    def objective(self) -> ObjectiveFigures:
        """What the report says of what was minimized."""
        telling = next((one for one in self.objectives if one.unresolved), self.objectives[0])
        errors = dict.fromkeys(one.error for one in self.objectives)
        return replace(telling.figures(self.model), error=", ".join(errors))


def joined(parts: Sequence[Solved], texels: Sequence[Tensor], btf: BTF) -> Solved:
    """One model of fits to some of the texels each.

    Args:
        parts: the fits.
        texels: of each fit, `[n]`; each texel is in one.
        btf: of all texels.
    """
    models = [part.model for part in parts]
    order = torch.argsort(torch.cat(list(texels)))
    labels, clusters = [], 0
    for model in models:
        labels.append(model.labels + clusters)
        clusters += model.cluster_count
    entries = _entries(models).of(order)
    exact = any(model.weight_type == torch.float32 for model in models)
    # Scales of bytes differ from part to part, and units of parts may be far from each other.
    kind = torch.int16 if not exact and are_within(entries.weight, torch.int16) else torch.float32
    whole = SPMM(
        btf.height,
        btf.width,
        LobeBatch.cat([model.dictionary.detach() for model in models]),
        rounded(entries, kind),
        torch.cat(labels)[order],
        _residual(models, btf),
        btf.light,
        btf.view,
        btf.name,
        components=joined_components(models, order, btf),
        weight_type=kind,
    )
    by_weight = [part.weighted or part.totals for part in parts]
    weighted = any(part.weighted for part in parts)
    return Solved(
        whole,
        Totals.sum(part.totals for part in parts),
        Totals.sum(by_weight) if weighted else None,
        tuple(one for part in parts for one in part.objectives),
        torch.stack([part.starts for part in parts]).sum(0),
        StatusCounts.sum(part.solvers for part in parts),
        torch.cat([own[part.samples] for own, part in zip(texels, parts, strict=True)]),
        sum(part.lobes_found for part in parts),
    )


def _entries(models: Sequence[SPMM]) -> SparseWeights:
    """The entries of all models, one after another, by lobes of all dictionaries."""
    offsets, indices, weights = [torch.zeros(1, dtype=torch.long)], [], []
    entries = lobes = 0
    for model in models:
        own = model.sparse_weights
        offsets.append(own.offset[1:] + entries)
        indices.append(own.index + lobes)
        weights.append(own.weight.detach())
        entries += len(own.index)
        lobes += len(model.dictionary)
    return SparseWeights(torch.cat(offsets), torch.cat(indices), torch.cat(weights))


def _residual(models: Sequence[SPMM], btf: BTF) -> Residual:
    """The residuals of the clusters of all models."""
    code = torch.cat([model.residual.code.detach() for model in models])
    scale = torch.cat([model.residual.scale for model in models])
    return Residual(code, scale, btf.light, btf.view)


def joined_components(models: Sequence[SPMM], order: Tensor, btf: BTF) -> Components | None:
    """The components of all models, each 0 in the texels of the others; None if none has any.

    Args:
        models: of the parts.
        order: place of each texel among those of all parts, `[T]`.
        btf: of all texels.
    """
    known = [model.components for model in models if model.components is not None]
    if not known:
        return None
    rank = sum(part.rank for part in known)
    texels = sum(model.texel_count for model in models)
    kind = reduce(torch.promote_types, (part.coefficient.dtype for part in known))
    coefficient = torch.zeros(texels, rank, dtype=kind)  # halves hold the codes of bytes exactly
    row = column = 0
    for model in models:
        if (own := model.components) is not None:
            part = own.coefficient.detach()
            coefficient[row : row + len(part), column : column + own.rank] = part
            column += own.rank
        row += model.texel_count
    return Components(
        torch.cat([part.code.detach() for part in known]),
        torch.cat([part.scale for part in known]),
        coefficient[order],
        torch.cat([part.coefficient_scale for part in known]),
        btf.light,
        btf.view,
    )
