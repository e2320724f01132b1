"""The number format of the weights in the file, and the fit beside weights that it holds."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import torch

from ...metrics import snr_db
from ...model.lookup import SparseWeights
from ...model.stored_weights import WEIGHT_TYPES, is_coded
from ...runtime.allocator import give_back_freed_memory
from .rounding import rounded_together
from .system import FAINT, MAX_ROUNDING_DB, System
from .turns import Turns


@dataclass(frozen=True)
class Rounded:
    """Weights as a file holds them, and the residual of rank R fit beside them.

    Attributes:
        kind: number format.
        entries: of all texels.
        turns: the residual; None for none.
    """

    kind: torch.dtype
    entries: SparseWeights
    turns: Turns | None


@dataclass(frozen=True)
class Storage:
    """The choice of a number format.

    Attributes:
        system: of the refit.
        entries: fit of all texels.
        turns: functions and coefficients of the residual beside them; None for none.
        by_clusters: squared error beside the residuals of the clusters; None for none.
        generator: of the rounding.
    """

    system: System
    entries: SparseWeights
    turns: Turns | None
    by_clusters: float | None
    generator: torch.Generator

    def chosen(self, asked: str) -> Rounded:
        """The weights by a format of `storage.weights`; `auto`: the first that costs little.

        Little is what no figure shows, neither that of the lobes nor that with the residual.
        """
        if asked != "auto":
            return self._rounded(WEIGHT_TYPES[asked])
        exact = self._rounded(torch.float32)
        energy, told = self.system.products.energy, self._by_products(exact)
        if min(told) < FAINT * energy:
            return exact
        before = told if self.by_clusters is None else [*told, self.by_clusters]
        for kind in filter(is_coded, WEIGHT_TYPES.values()):
            found = self._rounded(kind)
            pairs = zip(before, self._errors(found), strict=True)
            if all(snr_db(energy, a) - snr_db(energy, b) <= MAX_ROUNDING_DB for a, b in pairs):
                return found
        return exact

    def _rounded(self, kind: torch.dtype) -> Rounded:
        """The weights in a number format, and the residual fit again beside them."""
        system, turns = self.system, self.turns
        if not is_coded(kind):
            return Rounded(kind, self.entries, turns)
        target = system.products.lobes if turns is None else turns.target
        entries = rounded_together(self.entries, kind, system.normal, target, self.generator)
        give_back_freed_memory()
        return Rounded(kind, entries, None if turns is None else turns.beside(entries))

    def _by_products(self, found: Rounded) -> list[float]:
        """Squared errors that products tell: of the lobes alone, and with components."""
        if found.turns is None:
            return [self.system.error(found.entries.weight)]
        return [found.turns.lobes_error, found.turns.error]

    def _errors(self, found: Rounded) -> Iterator[float]:
        """Squared errors of the lobes alone, with components, and with residuals of clusters.

        The last would take a pass over the pictures. Rounding adds what it shows itself, as it
        knows nothing of what is left.
        """
        yield from self._by_products(found)
        if self.by_clusters is not None:
            yield self.by_clusters + self.system.shown(found.entries.weight - self.entries.weight)
