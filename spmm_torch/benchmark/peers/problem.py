"""What every peer gets, and what it gives back."""

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

# Groups of rows that may be compared: whole models of all texels, searches for lobes on a few
# texels, and fits of a few texels with lobes that are given.
WHOLE, SEARCH, SELECTION = "whole", "search", "selection"
HALF = torch.float16
HALF_BYTES = 2

Row = dict[str, Any]


@dataclass(frozen=True)
class Problem:
    """The data, and our own fit of them.

    Attributes:
        btf: the input, decoded.
        scope: how much to measure.
        device: of our own fit; peers in PyTorch use it too.
        ours: the fit with default settings.
    """

    btf: BTF
    scope: Scope
    device: torch.device
    ours: TimedFit

    @property
    def protocol(self) -> Protocol:
        """How often to measure."""
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
        """The lobes of our own model on all pairs, each of unit norm, `[J, D]`."""
        with torch.no_grad():
            atoms = self.grid.eval(self.ours.result.model.dictionary.detach().to(self.device))
        return atoms / atoms.norm(dim=1, keepdim=True)

    def some_texels(self, count: int) -> Tensor:
        """Indices of `count` texels, evenly spread."""
        count = min(count, self.btf.texel_count)
        return (torch.arange(count) + 0.5).mul(self.btf.texel_count / count).long()


@dataclass(frozen=True)
class Peer:
    """Another way to do what we do, or a part of it.

    Attributes:
        name: short.
        meaning: one sentence.
        run: measures it.
        package: that it needs and that may be missing, as it is imported; None: none.
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
        texels: how many it was measured on.
        timing: seconds, from decoded values.
        snr: in dB, over these texels.
        size: bytes of the model.
        lobes: mean number a texel.
        note: what the reader must know.
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
    """SNR in dB of `fitted` values, shaped as `values`."""
    energy = float(values.square().sum(dtype=torch.float64))
    return snr_db(energy, float((values - fitted).square().sum(dtype=torch.float64)))


def snr_of_weights(values: Tensor, weights: Tensor, atoms: Tensor) -> float:
    """SNR in dB of mixtures with dense `weights [n, C, J]` of `atoms [J, D]`."""
    return snr_of(values, (weights.to(atoms) @ atoms).transpose(1, 2))


def lobes_of_weights(weights: Tensor) -> float:
    """Mean number of lobes that any channel of a texel uses, from `weights [n, C, J]`."""
    return float((weights > 0.0).any(1).sum(1).double().mean())
