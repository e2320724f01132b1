"""The problem that every peer gets, and the rows that it returns."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import torch
from torch import Tensor

from ...data import BTF
from ...lobes.grid import DirectionGrid
from ...metrics import snr_db
from ..fits import TimedFit
from ..protocol import Protocol, Timing
from ..scope import Scope

# Groups of rows that can be compared: whole models of all texels, searches for lobes on a few
# texels, and weights of given lobes on a few texels.
WHOLE, SEARCH, SELECTION = "whole", "search", "selection"
HALF = torch.float16
HALF_BYTES = 2

Row = dict[str, Any]


@dataclass(frozen=True)
class Problem:
    """The data, and our own fit of them.

    Attributes:
        btf: the decoded input.
        scope: of the measurements.
        device: of our own fit, and of peers in PyTorch.
        ours: the fit with default settings.
    """

    btf: BTF
    scope: Scope
    device: torch.device
    ours: TimedFit

    @property
    def protocol(self) -> Protocol:
        """The protocol of all timings."""
        return self.scope.protocol

    @property
    def byte_budget(self) -> int:
        """The size of our own model."""
        return self.ours.result.report["bytes"]["total"]

    @cached_property
    def values(self) -> Tensor:
        """All values `[T, D, C]` on the device."""
        return self.btf.texels(device=self.device)

    @cached_property
    def grid(self) -> DirectionGrid:
        """The direction pairs."""
        return DirectionGrid.build(self.btf.light, self.btf.view, self.device)

    @cached_property
    def atoms(self) -> Tensor:
        """The lobes of our own model on all pairs, each of norm 1, `[J, D]`."""
        with torch.no_grad():
            atoms = self.grid.eval(self.ours.result.model.dictionary.detach().to(self.device))
        return atoms / atoms.norm(dim=1, keepdim=True)

    def some_texels(self, count: int) -> Tensor:
        """Indices `[n]` of `count` texels, evenly spread; of all if they are fewer."""
        count = min(count, self.btf.texel_count)
        return (torch.arange(count) + 0.5).mul(self.btf.texel_count / count).long()


@dataclass(frozen=True)
class Peer:
    """Another method for our task, or for a part of it.

    Attributes:
        name: short.
        meaning: one sentence.
        run: measures it.
        package: optional package that it imports; None for none.
    """

    name: str
    meaning: str
    run: Callable[[Problem], list[Row]]
    package: str | None = None


def row(
    name: str,
    group: str,
    texels: int,
    timing: Timing,
    snr: float,
    *,
    size: int | None = None,
    lobes: float | None = None,
    note: str = "",
) -> Row:
    """One line of the table of peers.

    Args:
        name: of what was measured.
        group: `WHOLE`, `SEARCH` or `SELECTION`.
        texels: number of measured texels.
        timing: seconds, from decoded values.
        snr: in dB, over these texels.
        size: bytes of the model.
        lobes: mean number of a texel.
        note: for the reader.
    """
    return {
        "name": name,
        "group": group,
        "texels": texels,
        "seconds": timing.to_dict(),
        "snr_db": snr,
        "bytes": size,
        "mean_basis_per_texel": lobes,
        "note": note,
    }


def snr_of(values: Tensor, fitted: Tensor) -> float:
    """SNR in dB of fitted values of any shape `[...]`, that of `values`."""
    energy = float(values.square().sum(dtype=torch.float64))
    return snr_db(energy, float((values - fitted).square().sum(dtype=torch.float64)))


def snr_of_weights(values: Tensor, weights: Tensor, atoms: Tensor) -> float:
    """SNR in dB for `values [n, D, C]` of mixtures `weights [n, C, J]` of `atoms [J, D]`."""
    return snr_of(values, (weights.to(atoms) @ atoms).transpose(1, 2))


def lobes_of_weights(weights: Tensor) -> float:
    """Mean number of lobes that any channel of a texel uses, from `weights [n, C, J]`."""
    return float((weights > 0.0).any(1).sum(1).double().mean())
