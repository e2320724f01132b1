"""The products D^T y of the texels of a cluster: the only passes over their direction pairs."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import torch
from torch import Tensor

from ..memory import scratch
from ..ranks import ALONE, Ranks
from .select import Products

# Direction pairs that are summed in float32: few enough for 24 bits, enough for vector registers.
RUN = 96
Load = Callable[[slice], Tensor]  # values [m, D, C] of some of this rank's texels of the cluster


def cluster_products(
    load: Load,
    parts: Sequence[slice],
    shape: tuple[int, int],
    atoms: Tensor,
    *,
    in_memory: bool = True,
    ranks: Ranks = ALONE,
    importance: Tensor | None = None,
) -> Products:
    """The products of n texels with the atoms, and with the mean of the whole cluster.

    Args:
        load: gives the values of some of the n texels.
        parts: blocks that cover them; each is loaded twice, but for a single one.
        shape: (n, C).
        atoms: `[J, D]`, of unit norm.
        in_memory: whether D^T y may lie in memory; else it goes to a scratch file.
        ranks: that share the cluster, n texels each or so.
        importance: weights of the n texels, `[n]`; None: 1.
    """
    texels, channels = shape
    device = atoms.device
    correlation = scratch((texels, len(atoms), channels), in_memory, device)
    energy = torch.zeros(texels, channels, dtype=torch.float64, device=device)
    total = torch.zeros(channels, atoms.shape[1], dtype=torch.float64, device=device)
    signals = torch.empty(0)
    weight = None if importance is None else importance.to(energy)  # [n]
    for part in parts:
        signals = _signals(load, part)
        correlation[part] = (signals @ atoms.T).transpose(1, 2).to(correlation.device)
        energy[part] = _inner(signals, signals)
        share = torch.ones(len(signals)).to(signals) if weight is None else weight[part].to(signals)
        total += torch.einsum("n,ncd->cd", share, signals)
    count, effective = _sizes(texels, weight, ranks)
    mean = (ranks.sum(total) / count).to(atoms.dtype)  # [C, D]
    overlap = torch.zeros_like(energy)
    for part in parts:
        if len(parts) > 1:
            signals = _signals(load, part)
        overlap[part] = _inner(signals, mean)
    along = overlap if weight is None else overlap * weight[:, None]
    return Products(
        gram=atoms @ atoms.T,
        correlation=correlation,
        energy=energy,
        overlap=overlap,
        mean=mean.T,
        mean_correlation=atoms @ mean.T,
        mean_energy=ranks.sum(along.sum(0)) / count,
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


def _inner(first: Tensor, second: Tensor) -> Tensor:
    """<first, second> over the pairs of `[..., D]`, float64: short runs in their own type, summed.

    As exact as the products with the atoms; to convert every value takes seven times as long.
    """
    pairs = zip(first.split(RUN, dim=-1), second.split(RUN, dim=-1), strict=True)
    return torch.stack([(a * b).sum(-1) for a, b in pairs]).sum(0, dtype=torch.float64)


def _signals(load: Load, part: slice) -> Tensor:
    """Values of some texels, channels first: `[m, C, D]`."""
    return load(part).transpose(1, 2).contiguous()
