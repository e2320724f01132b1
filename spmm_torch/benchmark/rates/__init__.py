"""Part rates: bytes against error, for our own model and its strongest peers.

Each method is measured at several sizes: ours at several ranks of its residual, local PCA at
several numbers of clusters and components, neural BTFs at several numbers of latent values; with a
relief and without one. All are stored in the same way: a signed byte for each number of a texel.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from ..fits import TimedFit
from ..scope import Bench, Scope
from .leads import leads_of
from .linear import local_pca_rows
from .networks import neural_rows
from .ours import MODES, our_rows
from .subject import Row, Subject, middle

# Most texels of a side: peers hold all values as floats. Of larger textures the middle is taken.
LARGEST_SIDE = 64


def count(scope: Scope) -> int:
    """The number of measurements."""
    ours = len(MODES) * len(scope.ranks)
    neural = len(scope.latents) * len(scope.training)
    return (1 + len(scope.materials)) * (ours + len(MODES) + neural)


def run(bench: Bench, default: TimedFit) -> dict[str, Any]:
    """Measures the input, and all other materials that the command names.

    Returns:
        `rows` of `subject.point`; and `leads` of `leads.leads_of` for each material.
    """
    rows, found = [], []
    for source in (bench.source, *bench.scope.materials):
        own = _rows(bench, source)
        rows += own
        found += [{"material": source.stem, **lead} for lead in leads_of(own)]
    return {"rows": rows, "leads": found}


def _rows(bench: Bench, source: Path) -> list[Row]:
    """All points of one material."""
    whole = bench.scope.selection
    selection = middle(bench.read(source, whole), LARGEST_SIDE)
    btf = bench.read(source, selection or whole).load()
    subject = Subject(source.stem, btf, bench)
    ours, relief = our_rows(subject)
    seconds = max(row["seconds"] for row in ours)
    return [*ours, *local_pca_rows(subject, relief), *neural_rows(subject, seconds)]
