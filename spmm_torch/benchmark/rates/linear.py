"""Local PCA at several numbers of clusters and components, with our relief and without one."""

from __future__ import annotations

import torch

from ...model.relief import Relief
from ..peers.local_pca import CLUSTERS, LocalPCA, drawn, local_pca, relief_bytes, surface
from ..peers.vector_quantization import clustered
from ..protocol import now
from .subject import Row, Subject

FLAT, RELIEF = "local PCA", "local PCA, our relief"


def local_pca_rows(subject: Subject, relief: Relief | None) -> list[Row]:
    """Points of all numbers of clusters and components.

    Args:
        subject: the material.
        relief: that our own fit found; None: it found none, so there is one line only.
    """
    rows = _rows(subject, FLAT, None)
    subject.bench.advance()
    if relief is not None:
        rows += _rows(subject, RELIEF, relief)
    subject.bench.advance()
    return rows


@torch.no_grad()
def _rows(subject: Subject, curve: str, relief: Relief | None) -> list[Row]:
    btf, bench = subject.btf, subject.bench
    points = surface(btf, relief)
    values = points.texels(device=bench.device)
    rows = []
    for clusters in (count for count in CLUSTERS if count <= btf.texel_count):
        start = now(bench.device)
        labels = clustered(points, clusters, bench.device).to(bench.device)
        found = local_pca(values, labels, max(bench.scope.ranks), len(btf.view))
        seconds = now(bench.device) - start
        rows += [
            _row(subject, curve, found.first(rank), relief, f"{clusters} x {rank}", seconds)
            for rank in bench.scope.ranks
        ]
    return rows


def _row(
    subject: Subject, curve: str, found: LocalPCA, relief: Relief | None, name: str, seconds: float
) -> Row:
    own, shared = relief_bytes(relief, found.texels)
    sizes = found.texel_bytes + own, found.shared_bytes + shared
    return subject.drawn(curve, name, drawn(found, subject.btf, relief), sizes, seconds)
