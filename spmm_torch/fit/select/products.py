"""The products D^T y of the texels of a cluster: the only pass over their direction pairs."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import torch
from torch import Tensor

from ...runtime.memory import scratch
from ...runtime.ranks import ALONE, Ranks
from .texels import Products

# Direction pairs that are summed in float32: few enough for 24 bits, enough to be fast.
RUN = 512
Load = Callable[[slice], Tensor]  # values [m, C, D] of some of this rank's texels of the cluster


def cluster_products(
    load: Load,
    parts: Sequence[slice],
    shape: tuple[int, int],
    atoms: Tensor,
    *,
    points: Tensor | None = None,
    in_memory: bool = True,
    ranks: Ranks = ALONE,
    importance: Tensor | None = None,
) -> Products:
    """The products of n texels with the atoms, and with the mean of the whole cluster.

    Args:
        load: gives the values of some of the n texels.
        parts: blocks that cover them; each is loaded once.
        shape: (n, C).
        atoms: `[J, D]`, of unit norm.
        points: principal coordinates of the n texels, `[n, P]`, for `Products.overlap`.
        in_memory: whether D^T y may lie in memory; else it goes to a scratch file.
        ranks: that share the cluster, n texels each or so.
        importance: weights of the n texels, `[n]`; None: 1.
    """
    texels, channels = shape
    device = atoms.device
    correlation = scratch((texels, len(atoms), channels), in_memory, device)
    energy = torch.zeros(texels, channels, dtype=torch.float64, device=device)
    total = torch.zeros(channels, atoms.shape[1], dtype=torch.float64, device=device)
    weight = None if importance is None else importance.to(energy)  # [n]
    for part in parts:
        signals = load(part)
        correlation[part] = _correlations(atoms, signals).to(correlation.device)
        energy[part] = _squared_norms(signals)
        share = torch.ones(len(signals)).to(signals) if weight is None else weight[part].to(signals)
        total += (share @ signals.flatten(1)).view_as(total)
    count, effective = _sizes(texels, weight, ranks)
    mean = ranks.sum(total) / count  # [C, D]
    mean_energy = mean.square().sum(1)
    overlap = None
    if points is not None:
        points = points.to(energy)
        weighted = points if weight is None else points * weight[:, None]
        overlap = _overlap(points, ranks.sum(weighted.sum(0)) / count, mean_energy.sum())
    mean_atoms = mean.to(atoms).T  # [D, C]
    return Products(
        gram=atoms @ atoms.T,
        correlation=correlation,
        energy=energy,
        overlap=overlap,
        mean=mean_atoms,
        mean_correlation=atoms @ mean_atoms,
        mean_energy=mean_energy,
        count=count,
        effective=effective,
        importance=weight,
    )


def _sizes(texels: int, weight: Tensor | None, ranks: Ranks) -> tuple[float, float]:
    """Count and effective count of all texels of a cluster, see `Products`."""
    if weight is None:
        count = int(ranks.sum(torch.tensor(texels)))
        return count, count
    sums = ranks.sum(torch.stack((weight.sum(), weight.square().sum())))
    return float(sums[0]), float(sums[0] ** 2 / sums[1])


def _correlations(atoms: Tensor, signals: Tensor) -> Tensor:
    """D^T y of atoms `[J, D]` and signals `[m, C, D]`: `[m, J, C]`, strided.

    The atoms first, which matrix products with few of them like better.
    """
    return (atoms @ signals.flatten(0, 1).T).unflatten(1, signals.shape[:2]).transpose(0, 1)


def _squared_norms(signals: Tensor) -> Tensor:
    """||y||^2 of every texel and channel of `[m, C, D]`, float64: norms of short runs, summed."""
    even = signals.shape[-1] // RUN * RUN
    runs = signals[..., :even].unflatten(-1, (-1, RUN))  # [m, C, D / RUN, RUN]
    rest = torch.linalg.vector_norm(signals[..., even:], dim=-1).double().square()
    return rest + torch.linalg.vector_norm(runs, dim=-1).double().square().sum(-1)


def _overlap(points: Tensor, centre: Tensor, mean_energy: Tensor) -> Tensor:
    """<y, mean y> of every texel, `[n]`, by coordinates `[n, P]` and their mean `[P]`.

    What the coordinates leave out is nearly orthogonal to the mean of many texels: each texel gets
    the average of it, which is known.
    """
    return points @ centre + (mean_energy - centre.square().sum())
