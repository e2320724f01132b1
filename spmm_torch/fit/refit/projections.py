"""The pass over the pictures that gives their products with the lobes.

Weights and exact errors are algebra of these products.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from ...data import BTF
from ...model.lookup import SparseWeights
from ...runtime.allocator import give_back_freed_memory
from ...runtime.ranks import Ranks
from ...runtime.sparse import sparse_product
from .lookups import Lookups
from .matrices import by_channel, columns_by_view, joint_matrix, matrix_of, products_at
from .pictures import pictures_of


@dataclass(frozen=True)
class Projections:
    """Products of all pictures Y_v, seen back on the texels.

    Attributes:
        lobes: sum_v < rho_j(v, .), (W_v^T Y_v)[q, .] > of each entry (q, j), `[N, C]` float64.
        energy: sum of squares of all pictures.
        means: sum over clusters of n ||mean||^2, the energy of the cluster means.
    """

    lobes: Tensor
    energy: float
    means: float

    def to_tensors(self) -> dict[str, Tensor]:
        """Tensors for a checkpoint: `lobes [N, C]` and `sums [2]`."""
        sums = torch.tensor((self.energy, self.means), dtype=torch.float64)
        return {"lobes": self.lobes, "sums": sums}

    @classmethod
    def from_tensors(cls, tensors: dict[str, Tensor]) -> Projections:
        """The products of a checkpoint; see `Projections.to_tensors`."""
        return cls(tensors["lobes"], *tensors["sums"].tolist())

    def to(self, device: torch.device) -> Projections:
        """The same on another device: what a checkpoint held is on the CPU."""
        return replace(self, lobes=self.lobes.to(device))


def project(
    pictures: BTF,
    scale: Tensor | None,
    lookups: Lookups,
    entries: SparseWeights,
    rho: Tensor,
    labels: Tensor,
    ranks: Ranks,
    advance: Callable[[int], object],
) -> Projections:
    """Reads all pictures once; every rank has a part of the views.

    Args:
        pictures: as they were measured.
        scale: square roots of the weights of pairs, `[D]`; None: 1.
        lookups: what each pixel shows, with the weights of pixels.
        entries: lobes of all texels; weights are not read.
        rho: values of the lobes with the weights of pairs, `[V, J, L]`.
        labels: clusters of the texels, `[T]`.
        ranks: processes among which the views are divided.
        advance: called with the number of views done.
    """
    device, channels = rho.device, pictures.channels
    lobes = torch.zeros(entries.weight.numel(), dtype=torch.float64, device=device)
    sums = torch.zeros(2, dtype=torch.float64, device=device)
    members = _members(labels.to(device), lookups.pixel)
    pattern = joint_matrix(entries, rho.shape[1])
    runs = lookups.runs(*ranks.span(lookups.views))
    for run in runs:  # before the pictures: what is kept would lie in the holes that these leave
        lookups.gathered(run, apart=True)
    give_back_freed_memory()

    def of_run(run: slice) -> tuple[Tensor, Tensor]:
        """(sums, products) of a run, whose pictures are freed before the next ones come."""
        picture = pictures_of(pictures, run, lookups, device)  # [n, T, L C]
        if scale is not None:
            by_view = scale.view(lookups.views, 1, -1)[run]
            picture = picture * by_view.repeat_interleave(channels, dim=2)
        shown = sparse_product(lookups.gathered(run, apart=True), picture.flatten(0, 1))
        columns, values = columns_by_view(shown, run), by_channel(rho[run], channels)
        return _sums(picture, members), products_at(pattern, columns, values)

    for run in runs:
        more, shown = of_run(run)
        sums, lobes = sums + more, lobes + shown
        advance(ranks.size * (run.stop - run.start))
    energy, means = ranks.sum(sums.cpu()).tolist()
    return Projections(ranks.sum(lobes).view(-1, channels), energy, means)


def _members(labels: Tensor, pixel: Tensor | None) -> tuple[Tensor, Tensor]:
    """Which texels are in each cluster, sparse CSR `[K, T]`, and how many, `[K]`.

    Args:
        labels: clusters of the texels, `[T]`.
        pixel: square roots of the weights of the texels, `[T]`, by which pictures are scaled;
            None: all 1. They then stand for 1, and count by their squares.
    """
    texels, clusters = len(labels), int(labels.max()) + 1
    value = torch.ones(texels, device=labels.device) if pixel is None else pixel
    every = torch.arange(texels, device=labels.device)
    matrix = matrix_of(labels, every, value, (clusters, texels))
    return matrix, value.new_zeros(clusters).index_add_(0, labels, value.square())


def _sums(pictures: Tensor, members: tuple[Tensor, Tensor]) -> Tensor:
    """Energy of pictures `[n, T, L C]` and of the means of clusters, `[2]` float64.

    Args:
        pictures: of n views.
        members: see `_members`.
    """
    matrix, count = members
    energy = torch.linalg.vector_norm(pictures, dim=2).double().square().sum()
    total = torch.stack([sparse_product(matrix, rows) for rows in pictures]).double()  # [n, K, L C]
    means = (total.square() / count[:, None]).sum()
    return torch.stack((energy, means))
