"""Materials of one kind: those that one objective suits, among texels that are no neighbours.

Errors of a texture are weighed alike in all texels. Unrelated materials in one fit may be matt,
glossy, or mirrors of metal or of a dielectric, and what suits one harms another.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import torch
from torch import Tensor

from ...config.fit import FitConfig
from ...data import BTF
from ...data.blocks import block_texels
from ...data.pair_lists import ListStore
from ...lobes.grid import DirectionGrid
from ...runtime.memory import slices
from ...runtime.progress import Advance
from .compression import BALANCED, L2
from .measure import is_glossy
from .peaks import unresolved
from .trial import STEPS, best_errors
from .views import BY_VIEW

MATT, GLOSSY, DIELECTRIC, METAL = "matt", "glossy", "mirrors of dielectrics", "mirrors of metal"
# Glossy ones that squared errors suit.
PLAIN = "glossy by squared errors"
# Kinds of glossy materials by the errors that suit them.
BY_ERROR = {L2: PLAIN, BY_VIEW: "glossy by view", BALANCED: GLOSSY}
# Glossy materials that are tried together.
TRIED = 32


@dataclass(frozen=True)
class Kind:
    """Materials of one kind.

    Attributes:
        name: of the kind.
        texels: their indices, ascending, `[n]`.
    """

    name: str
    texels: Tensor

    @property
    def suited(self) -> str | None:
        """The errors that suit them, if a trial has told."""
        return next((error for error, name in BY_ERROR.items() if name == self.name), None)

    def part(self, btf: BTF) -> BTF:
        """The BTF of these materials alone, in memory."""
        store = ListStore(btf.texels(self.texels))
        own = btf.restricted(self.texels, (1, len(self.texels)))
        return replace(own, open_store=lambda part, loading: store, cosine_missing=False)


def has_kinds(btf: BTF, config: FitConfig) -> bool:
    """Whether texels are unrelated materials, and the settings leave open what to minimize."""
    plain = config.weights.error != "auto" or config.search.method == "stagewise" or config.auto
    return btf.names is not None and btf.texel_count > 1 and not plain


def kinds(btf: BTF, config: FitConfig, device: torch.device, advance: Advance) -> list[Kind]:
    """The kinds of unrelated materials, most of them first.

    Args:
        btf: decoded.
        config: of the fit.
        device: of the computation.
        advance: receives `STEPS` units a material.
    """
    grid = DirectionGrid.build(btf.light, btf.view, device)
    width = config.search.min_width * grid.spacing
    names = [
        _kind(grid, value[None], width)
        for block in slices(btf.texel_count, block_texels(btf, device))
        for value in btf.signals(block, device)
    ]
    advance(STEPS * (len(names) - names.count(GLOSSY)))
    names = _with_trial(names, btf, grid, config, device, advance)
    found = [
        Kind(name, torch.tensor([texel for texel, own in enumerate(names) if own == name]))
        for name in dict.fromkeys(names)
    ]
    return sorted(found, key=lambda kind: -len(kind.texels))


def _kind(grid: DirectionGrid, value: Tensor, width: float) -> str:
    """The kind of one material, of values `[1, C, D]`."""
    if not bool(value.any()) or not is_glossy(value):
        return MATT
    peak = unresolved(grid, value, width)
    if peak is None:
        return GLOSSY
    return METAL if peak.metal else DIELECTRIC


def _with_trial(
    names: list[str],
    btf: BTF,
    grid: DirectionGrid,
    config: FitConfig,
    device: torch.device,
    advance: Advance,
) -> list[str]:
    """The kinds of all materials, where the glossy ones are apart by the errors that suit them."""
    glossy = torch.tensor([place for place, name in enumerate(names) if name == GLOSSY])
    told = list(names)
    for some in glossy.long().split(TRIED) if len(glossy) else ():
        errors = best_errors(grid, btf.signals(some, device), config.search, advance)
        for place, error in zip(some.tolist(), errors, strict=True):
            told[place] = BY_ERROR[error]
    return told
