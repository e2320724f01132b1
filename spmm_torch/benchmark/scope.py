"""How much a benchmark measures: a full one, and a small one that only shows that it runs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import torch

from ..data import BTF, Selection, load_btf
from ..runtime.progress import Progress
from .protocol import Protocol
from .repeats import FULL_REPEATS, SMALL_REPEATS


@dataclass(frozen=True)
class Scope:
    """What is measured.

    Attributes:
        protocol: repeats.
        selection: part of the input.
        overrides: of every setting that is fit with.
        sweep: groups of variants that are swept; None: all.
        search_texels: on which the search by SciPy is measured, which is too slow for more.
        dictionary_texels: on which the solvers for one texel at a time are measured.
        training: times that the neural peer trains, in times that the default fit takes.
        texels: counts that scaling is measured at.
        few_texels: scaling with one thread is measured up to so many.
        direction_texels: at which the number of directions is varied.
        product, copied: side of the matrices, and bytes, that tell what the machine can do.
    """

    protocol: Protocol
    selection: Selection = Selection()
    overrides: tuple[str, ...] = ()
    sweep: tuple[str, ...] | None = None
    search_texels: int = 3
    dictionary_texels: int = 48
    training: tuple[float, ...] = (1.0, 10.0)
    texels: tuple[int, ...] = (1024, 4096, 16384, 65536)
    few_texels: int = 16384
    direction_texels: int = 1024
    product: int = 2048
    copied: int = 1 << 28


# A part of the input that is fit before anything counts.
WARM_UP = Selection(texels=16, directions="0,30,60")

FULL = Scope(Protocol(repeats=FULL_REPEATS, patience=40.0))
SMALL = Scope(
    Protocol(repeats=SMALL_REPEATS, patience=0.5),
    selection=Selection(texels=64, directions="0,30,60"),
    overrides=(
        "cluster.count=4",
        "sample.per_cluster=2",
        "search.models=[lambertian, ward]",
        "search.max_lobes=2",
        "search.restarts=1",
        "search.bank_normals=16",
        "search.final_steps=2",
        "search.exchanges=0",
    ),
    sweep=("dictionary", "precision"),
    search_texels=1,
    dictionary_texels=4,
    training=(0.2, 2.0),
    texels=(64, 256, 1024),
    few_texels=256,
    direction_texels=16,
    product=512,
    copied=1 << 24,
)


@dataclass(frozen=True)
class Bench:
    """What all parts of a benchmark share.

    Attributes:
        source: the input.
        scope: how much to measure.
        device: of the fits.
        progress: who is told how far it is.
        advance: called once for each thing that was measured.
    """

    source: Path
    scope: Scope
    device: torch.device
    progress: Progress
    advance: Callable[[], None]

    def open(self) -> BTF:
        """The input, not decoded yet."""
        return load_btf(self.source, selection=self.scope.selection)

    def with_selection(self, selection: Selection) -> Bench:
        """The same for another part of the input."""
        return replace(self, scope=replace(self.scope, selection=selection))
