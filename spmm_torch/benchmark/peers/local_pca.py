"""Local PCA: a mean and a few principal components for each cluster, at the bytes of our model.

The strongest linear method at equal bytes [Mueller, Meseth, Klein 2003]. It is stored as our own
residual is: functions and coefficients in signed bytes. The bytes allow few clusters with many
components, or many clusters with few; the best split is published. Where our model has a relief,
the same is done on the values that it aligns, and drawn through it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import torch
from torch import Tensor

from ...data import BTF
from ...model.components import (
    decode_coefficients,
    decode_functions,
    encode_coefficients,
    encode_functions,
)
from ...model.relief import Relief
from ..drawing import OfView, snr_of_pictures, through
from ..protocol import measure
from .problem import WHOLE, Peer, Problem, Row, row
from .vector_quantization import clustered, label_bytes

CLUSTERS = (1, 2, 4, 8, 16)
SCALE_BYTES = 4


@dataclass(frozen=True)
class Piece:
    """One cluster as a file would hold it.

    Attributes:
        texels: its texels, `[n]`.
        code: of its mean, which comes first, and of its components, `[1 + R, V, L, C]` int8.
        scale: of these, `[1 + R, V]`.
        coefficient: codes `[n, R]` int8.
        coefficient_scale: `[R]`.
    """

    texels: Tensor
    code: Tensor
    scale: Tensor
    coefficient: Tensor
    coefficient_scale: Tensor

    @property
    def shared_bytes(self) -> int:
        """Bytes of what its texels share."""
        scales = self.scale.numel() + self.coefficient_scale.numel()
        return self.code.numel() + SCALE_BYTES * scales

    def first(self, components: int) -> Piece:
        """The same with its first components only."""
        functions = slice(0, 1 + components)
        return replace(
            self,
            code=self.code[functions],
            scale=self.scale[functions],
            coefficient=self.coefficient[:, :components],
            coefficient_scale=self.coefficient_scale[:components],
        )

    def values(self, view: int) -> Tensor:
        """Values `[n, L, C]` of its texels under a view."""
        one = slice(view, view + 1)
        functions = decode_functions(self.code[:, one], self.scale[:, one])[:, 0]  # [1 + R, L, C]
        flat = functions.flatten(1)
        weights = decode_coefficients(self.coefficient, self.coefficient_scale)
        return (flat[:1] + weights @ flat[1:]).view(-1, *functions.shape[1:])


@dataclass(frozen=True)
class LocalPCA:
    """All clusters."""

    pieces: tuple[Piece, ...]

    @property
    def texels(self) -> int:
        """Number of texels, T."""
        return sum(len(piece.texels) for piece in self.pieces)

    @property
    def texel_bytes(self) -> int:
        """Bytes of coefficients and labels."""
        label = label_bytes(len(self.pieces))
        return sum(piece.coefficient.numel() for piece in self.pieces) + label * self.texels

    @property
    def shared_bytes(self) -> int:
        """Bytes of means and components."""
        return sum(piece.shared_bytes for piece in self.pieces)

    def first(self, components: int) -> LocalPCA:
        """The same with the first components of each cluster only."""
        return LocalPCA(tuple(piece.first(components) for piece in self.pieces))

    def of_view(self, view: int) -> Tensor:
        """Values `[T, L, C]` under a view."""
        parts = [piece.values(view) for piece in self.pieces]
        out = parts[0].new_empty(self.texels, *parts[0].shape[1:])
        for piece, part in zip(self.pieces, parts, strict=True):
            out[piece.texels] = part
        return out


def relief_bytes(relief: Relief | None, texels: int) -> tuple[int, int]:
    """Bytes of a relief that belong to T texels, and those that they share."""
    if relief is None:
        return 0, 0
    code, *rest = relief.encoded()
    drift = 0 if relief.drift is None else relief.drift.numel()
    shared = SCALE_BYTES * (len(rest) + drift)
    return (0 if code is None else texels), shared


def local_pca(values: Tensor, labels: Tensor, components: int, views: int) -> LocalPCA:
    """The principal components of each cluster; a cluster has fewer than texels.

    Args:
        values: `[T, D, C]`.
        labels: cluster of each texel, `[T]`.
        components: of each cluster, at most.
        views: V; pairs are view by view.
    """
    pieces = []
    for cluster in torch.unique(labels).tolist():
        members = torch.nonzero(labels == cluster).squeeze(1)
        own = values[members]
        shape = (-1, views, own.shape[1] // views, own.shape[2])  # of functions
        own = own.flatten(1)  # [n, D C]
        mean = own.mean(0, keepdim=True)
        centred = own - mean
        rank = min(components, len(members) - 1)
        vectors = torch.linalg.eigh((centred @ centred.T).double()).eigenvectors.flip(1)
        basis = torch.linalg.qr(centred.T @ vectors[:, :rank].float()).Q  # [D C, r]
        functions = torch.cat((mean, basis.T)).view(shape)
        code = encode_functions(functions, torch.int8)
        pieces.append(Piece(members, *code, *encode_coefficients(centred @ basis)))
    return LocalPCA(tuple(pieces))


def component_count(problem: Problem, clusters: int, relief: Relief | None = None) -> int:
    """Components of each cluster that the bytes of our own model allow."""
    btf = problem.btf
    texels = btf.texel_count
    function = btf.pair_count * btf.channels + SCALE_BYTES * len(btf.view)
    left = problem.byte_budget - texels * label_bytes(clusters) - clusters * function
    left -= sum(relief_bytes(relief, texels))
    return max(0, left // (clusters * (function + SCALE_BYTES) + texels))


def surface(btf: BTF, relief: Relief | None) -> BTF:
    """The BTF as its surface points look: aligned through a relief, if there is one."""
    if relief is None:
        return btf
    return btf.aligned(relief.field(btf.height, btf.width, btf.view), relief.drift)


def drawn(found: LocalPCA, btf: BTF, relief: Relief | None) -> OfView:
    """Its pictures, through a relief if there is one."""
    return found.of_view if relief is None else through(found.of_view, btf, relief)


def run(problem: Problem) -> list[Row]:
    """The best split of the bytes, and the best with the relief of our own model, if it has one."""
    relief = problem.ours.result.model.relief
    return [_best(problem, each) for each in (None, relief)[: 1 if relief is None else 2]]


def _best(problem: Problem, relief: Relief | None) -> Row:
    """Measures all splits of the bytes, and keeps the best one."""
    btf, device = problem.btf, problem.device
    points = surface(btf, relief)
    values = problem.values if relief is None else points.texels(device=device)
    rows = []
    for clusters in CLUSTERS:
        components = component_count(problem, clusters, relief)
        if components == 0 and rows:
            break

        @torch.no_grad()
        def work(clusters: int = clusters, components: int = components) -> LocalPCA:
            labels = clustered(points, clusters, device).to(device)
            return local_pca(values, labels, components, len(btf.view))

        found, timing = measure(work, problem.protocol, device, warm_up=not rows)
        size = found.texel_bytes + found.shared_bytes + sum(relief_bytes(relief, found.texels))
        snr = snr_of_pictures(btf, drawn(found, btf, relief))
        name = f"local PCA, {clusters} x {components}" + (", relief" if relief else "")
        note = f"best split of the bytes among {', '.join(map(str, CLUSTERS))} clusters"
        if relief is not None:
            note += "; time without that to find the relief and to align values by it"
        rows.append(row(name, WHOLE, btf.texel_count, timing, snr, size=size, note=note))
    return max(rows, key=lambda each: each["snr_db"])


PEER = Peer("local PCA", "clusters with principal components, at the bytes of our model", run)
