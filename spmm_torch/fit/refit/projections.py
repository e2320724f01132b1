"""The pass over the pictures that gives their products with the lobes.

Weights and exact errors are algebra of these products.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from ...data import BTF
from ...lobes.ragged import ranges
from ...model.lookup import SparseWeights
from ...runtime.memory import slices
from ...runtime.ranks import Ranks
from .lookups import Lookups

# Bytes of the pictures of consecutive views that are read at once, as float32.
READ_BYTES = 1 << 28
# Values of products of texels with all lobes that are held at once: 64 MB.
PRODUCT_VALUES = 1 << 24


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
    lobes = torch.zeros(len(entries.index), channels, dtype=torch.float64, device=device)
    sums = torch.zeros(2, dtype=torch.float64)
    mine = ranks.share(torch.arange(lookups.views)).tolist()
    size = max(1, READ_BYTES // (4 * pictures.texel_count * rho.shape[2] * channels))
    for part in slices(len(mine), size):
        views = mine[part]
        values = pictures.views(views[0], views[-1] + 1)  # [T, v, L, C]
        for place, view in enumerate(views):
            picture = values[:, place].to(device)
            if scale is not None:
                picture = picture * scale.view(lookups.views, -1, 1)[view]
            if lookups.pixel is not None:
                picture = picture * lookups.pixel[:, None, None]
            sums += _sums(picture, labels.to(device), lookups.pixel)
            seen = (lookups.gathered(view) @ picture.flatten(1)).view_as(picture)  # [T, L, C]
            _add_lobes(lobes, seen, rho[view], entries)
        advance(len(views) * ranks.size)
    energy, means = ranks.sum(sums).tolist()
    return Projections(ranks.sum(lobes), energy, means)


def _sums(picture: Tensor, labels: Tensor, pixel: Tensor | None) -> Tensor:
    """Energy of a picture `[T, L, C]` and of the weighted means of its clusters, `[2]` float64.

    `pixel [T]` are the square roots of the weights, by which the picture is scaled; None: all 1.
    """
    energy = torch.linalg.vector_norm(picture, dim=2).double().square().sum()
    if pixel is None:
        pixel = picture.new_ones(len(picture))
    count = torch.bincount(labels, pixel.double().square())
    scaled = picture * pixel[:, None, None]
    total = picture.new_zeros(len(count), *picture.shape[1:]).index_add_(0, labels, scaled)
    means = (total.double().square().flatten(1).sum(1) / count).sum()
    return torch.stack((energy, means)).cpu()


def _add_lobes(total: Tensor, seen: Tensor, rho: Tensor, entries: SparseWeights) -> None:
    """Adds the products of `seen [T, L, C]` with `rho [J, L]` to `total [N, C]`."""
    lobes = len(rho)
    for texels in slices(len(seen), max(1, PRODUCT_VALUES // (lobes * seen.shape[2]))):
        offset = entries.offset[texels.start : min(texels.stop, len(seen)) + 1]
        part = seen[texels].transpose(1, 2).reshape(-1, seen.shape[1])  # [m C, L]
        product = (part @ rho.T).view(-1, seen.shape[2], lobes)  # [m, C, J]
        texel, entry = ranges(offset[:-1], offset[1:] - offset[:-1])
        total[entry] += product[texel, :, entries.index[entry]].double()
