"""Stage dictionary: the union of the lobes of all samples, without duplicates [WDR11 §4.1]."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import torch
from torch import Tensor

from ..config.fit import DictionaryConfig
from ..lobes.batch import LobeBatch
from ..lobes.grid import DirectionGrid, distinct
from ..solvers.status import StatusCounts
from .problem import Problem

# Tensors of lobes in a checkpoint, in the order of the fields of `LobeBatch`.
LOBE_TENSORS = ("model", "kappa", "normal", "angle")


@dataclass(frozen=True)
class FoundLobes:
    """The lobes that a search found.

    Attributes:
        lobes: N lobes.
        cluster: cluster of the sample of each lobe, `[N]` on the CPU.
        error: relative squared error of the sample of each lobe, `[N]` on the CPU.
        starts: all starts, those that met NaN or infinity, and those from which no step went
            down, `[3]` on the CPU.
        solvers: problems of the search by solver and status.
    """

    lobes: LobeBatch
    cluster: Tensor
    error: Tensor
    starts: Tensor
    solvers: StatusCounts = field(default_factory=StatusCounts.none)

    def on_cpu(self) -> FoundLobes:
        """The same lobes on the CPU."""
        return replace(self, lobes=self.lobes.to("cpu"), solvers=self.solvers.to("cpu"))

    def to_tensors(self) -> dict[str, Tensor]:
        """Tensors for a checkpoint: `cluster [N]`, `error [N]` and others by their names."""
        own = {name: getattr(self, name) for name in ("cluster", "error", "starts")}
        lobes = {name: getattr(self.lobes, name) for name in LOBE_TENSORS}
        horizon = torch.tensor(self.lobes.horizon, dtype=torch.float64)
        return {**own, "solvers": self.solvers.table, **lobes, "horizon": horizon}

    @classmethod
    def from_tensors(cls, tensors: dict[str, Tensor]) -> FoundLobes:
        """The lobes of a checkpoint, on the CPU; see `FoundLobes.to_tensors`."""
        parts = (tensors[name] for name in LOBE_TENSORS)
        cluster, error, starts = (tensors[name] for name in ("cluster", "error", "starts"))
        lobes = LobeBatch(*parts, horizon=float(tensors["horizon"]))
        return cls(lobes, cluster, error, starts, StatusCounts(tensors["solvers"]))


@dataclass(frozen=True)
class Dictionary:
    """The lobes that texels choose from.

    Attributes:
        lobes: J lobes.
        atoms: their weighted values on all pairs, scaled to unit norm, `[J, D]`.
        norm: norms that the values had, `[J]`.
        choices: for each cluster, the indices `[N]` of the lobes that it may choose.
        raw: the values without the weights of the pairs, over the same norm, `[J, D]`.
    """

    lobes: LobeBatch
    atoms: Tensor
    norm: Tensor
    choices: list[Tensor]
    raw: Tensor

    @property
    def is_shared(self) -> bool:
        """Whether every cluster may choose every lobe."""
        return all(len(choice) == len(self.atoms) for choice in self.choices)


def build_dictionary(problem: Problem, found: FoundLobes, cluster_count: int) -> Dictionary:
    """The dictionary of all clusters."""
    with problem.context.watch("dictionary"):
        return merge_lobes(found, cluster_count, problem.grid(), problem.config.dictionary)


def merge_lobes(
    found: FoundLobes, cluster_count: int, grid: DirectionGrid, config: DictionaryConfig
) -> Dictionary:
    """Merges lobes that correlate more than `config.merge`; the lobe of the better fit stays."""
    lobes = found.lobes.to(grid.light.device)
    values = grid.eval(lobes)
    norm = values.norm(dim=1)
    visible = torch.nonzero(norm > 0.0).squeeze(1)
    rank = found.error.to(norm.device)[visible].argsort(stable=True)
    order = visible[rank]
    atoms = values[order] / norm[order, None]
    owner = found.cluster.to(norm.device)[order]
    if config.scope == "shared":
        kept = distinct(atoms, config.merge)
        choices = [torch.arange(len(kept), device=kept.device)] * cluster_count
    else:
        groups = [torch.nonzero(owner == k).squeeze(1) for k in range(cluster_count)]
        groups = [group[distinct(atoms[group], config.merge)] for group in groups]
        kept = torch.cat(groups)
        every = torch.arange(len(kept), device=kept.device)
        choices = list(every.split([len(group) for group in groups]))
    lobes, atoms, norm = lobes[order][kept], atoms[kept], norm[order][kept]
    raw = atoms if grid.scale is None else grid.unscaled.eval(lobes) / norm[:, None]
    return Dictionary(lobes, atoms, norm, choices, raw)
