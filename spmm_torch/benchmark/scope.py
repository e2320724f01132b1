"""The scope of a benchmark: full, or small just to show that it runs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import torch

from ..data import BTF, ReadOptions, Selection, load_btf
from ..data.options import DEFAULT_OPTIONS
from ..runtime.progress import Progress
from .protocol import Protocol
from .repeats import FULL_REPEATS, SMALL_REPEATS


@dataclass(frozen=True)
class Scope:
    """The measurements of a benchmark.

    Attributes:
        protocol: of all timings.
        selection: part of the input.
        overrides: settings of all fits, over those of their files.
        sweep: groups of variants that are swept; None for all.
        search_texels: texels of the search by SciPy, which is too slow for more.
        dictionary_texels: texels of the solvers for one texel at a time.
        training: training times of the neural peers, in units of the time of our own fit.
        ranks: of the residual of our model, and components of local PCA, for rates.
        latents: latent values a texel of the neural peers, for rates.
        materials: further inputs whose rates are measured.
        texels: numbers of texels for scaling.
        few_texels: most texels for scaling with one thread.
        direction_texels: texels while the number of directions varies.
        product, copied: side of the matrices, and bytes of the copy, that measure the machine.
    """

    protocol: Protocol
    selection: Selection = Selection()
    overrides: tuple[str, ...] = ()
    sweep: tuple[str, ...] | None = None
    search_texels: int = 3
    dictionary_texels: int = 48
    training: tuple[float, ...] = (1.0, 10.0)
    ranks: tuple[int, ...] = (0, 4, 8, 16, 32, 64)
    latents: tuple[int, ...] = (8, 24)
    materials: tuple[Path, ...] = ()
    texels: tuple[int, ...] = (1024, 4096, 16384, 65536)
    few_texels: int = 16384
    direction_texels: int = 1024
    product: int = 2048
    copied: int = 1 << 28


# The part of the input that is fitted to warm up.
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
    ranks=(0, 4),
    latents=(4,),
    texels=(64, 256, 1024),
    few_texels=256,
    direction_texels=16,
    product=512,
    copied=1 << 24,
)


@dataclass(frozen=True)
class Bench:
    """Input, scope and device of all parts of a benchmark.

    Attributes:
        source: the input.
        scope: of the measurements.
        device: of the fits.
        progress: of the command.
        advance: called after each measurement.
        reading: how the input, and further materials, are read.
    """

    source: Path
    scope: Scope
    device: torch.device
    progress: Progress
    advance: Callable[[], None]
    reading: ReadOptions = DEFAULT_OPTIONS

    def open(self) -> BTF:
        """The input, not decoded yet."""
        return self.read(self.source, self.scope.selection)

    def read(self, source: Path, selection: Selection) -> BTF:
        """A part of an input, not decoded yet."""
        return load_btf(source, self.reading, selection=selection)

    def with_selection(self, selection: Selection) -> Bench:
        """The same for another part of the input."""
        return replace(self, scope=replace(self.scope, selection=selection))
