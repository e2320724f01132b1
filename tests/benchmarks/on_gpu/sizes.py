"""How much each part of the benchmark of a GPU does."""

from __future__ import annotations

from dataclasses import dataclass

from spmm_torch.benchmark.scope import SMALL as SMALL_SCOPE
from spmm_torch.data import Selection


@dataclass(frozen=True)
class Sizes:
    """Sizes of all parts.

    Attributes:
        selection: part of the bundled sample.
        overrides: settings of all fits.
        small, full: sides of the made-up BTFs, in texels.
        texture: side of the made-up model, in texels.
        queries: triples, and samples, evaluated at once.
        batch, steps: queries of a training step, and steps that are timed.
        picture: side of the picture, in pixels.
        product, copied: side of the matrices, and bytes of the copy.
        patience: seconds after which nothing is repeated.
    """

    selection: Selection = Selection()
    overrides: tuple[str, ...] = ()
    small: int = 64
    full: int = 256
    texture: int = 256
    queries: int = 1_000_000
    batch: int = 1 << 16
    steps: int = 20
    picture: int = 512
    product: int = 8192
    copied: int = 1 << 31
    patience: float = 3.0


FULL = Sizes()
SMALL = Sizes(
    SMALL_SCOPE.selection,
    (*SMALL_SCOPE.overrides, "cluster.count=2", "residual.rank=2", "relief.mode=off"),
    small=8,
    full=12,
    texture=4,
    queries=300,
    batch=100,
    steps=2,
    picture=12,
    product=64,
    copied=1 << 16,
    patience=0.0,
)
