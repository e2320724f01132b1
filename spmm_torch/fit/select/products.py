"""The products D^T y of the texels of a cluster: the only pass over their direction pairs.

References:
    [Kis65] Leslie Kish, Survey Sampling, Wiley, 1965, section 8.2.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from ...runtime.memory import scratch
from ...runtime.ranks import ALONE, Ranks

# Direction pairs whose squares are summed in float32: few enough for 24 bits, enough to be fast.
RUN = 512
# Values `[m, C, D]` of some of the texels of a cluster.
Load = Callable[[slice], Tensor]


@dataclass(frozen=True)
class Products:
    """The products of n of the N texels of a cluster with J atoms of unit norm.

    Attributes:
        gram: D^T D, `[J, J]`.
        correlation: D^T y, `[n, J, C]`.
        energy: ||y||^2, `[n, C]` float64.
        mean: mean y over the whole cluster, `[D, C]`.
        mean_correlation: D^T mean y, `[J, C]`.
        mean_energy: ||mean y||^2, `[C]` float64.
        count: N, or the sum of the weights of the N texels.
        effective: N, or the effective sample size of weighted texels [Kis65].
        importance: the weights of the n texels, `[n]` float64; None: 1.
        overlap: <y, mean y> summed over channels, `[n]` float64, approximate; None where no
            residual is fit beside the lobes.
    """

    gram: Tensor
    correlation: Tensor
    energy: Tensor
    mean: Tensor
    mean_correlation: Tensor
    mean_energy: Tensor
    count: float
    effective: float
    importance: Tensor | None = None
    overlap: Tensor | None = None

    def part(self, texels: slice) -> Products:
        """The products of some of the n texels; what is of the whole cluster stays."""
        return replace(
            self,
            correlation=self.correlation[texels].to(self.gram.device),
            energy=self.energy[texels],
            overlap=None if self.overlap is None else self.overlap[texels],
            importance=None if self.importance is None else self.importance[texels],
        )

    def total(self, values: Tensor) -> Tensor:
        """The sum `[]` of values `[n, ...]` times the weights of their texels."""
        if self.importance is None:
            return values.sum()
        return (values * self.importance.view(-1, *[1] * (values.dim() - 1))).sum()

    def least_gain(self, fraction: float) -> float | Tensor:
        """The fraction of the error of a texel that a lobe must take away; `[n]` where it varies.

        A lobe costs the same in all texels: where errors count twice, half the fraction will do.
        """
        return fraction if self.importance is None else (fraction / self.importance).clamp(max=1.0)


def cluster_products(
    load: Load,
    parts: Sequence[slice],
    shape: tuple[int, int],
    atoms: Tensor,
    *,
    points: Tensor | None = None,
    gram: Tensor | None = None,
    in_memory: bool = True,
    ranks: Ranks = ALONE,
    importance: Tensor | None = None,
) -> Products:
    """The products of n texels of a cluster with the atoms, and the mean of the whole cluster.

    Args:
        load: gives the values of some of the n texels.
        parts: blocks of the n texels; each is loaded once.
        shape: (n, C).
        atoms: `[J, D]`, of unit norm.
        points: principal coordinates of the n texels, `[n, P]`, for `Products.overlap`.
        gram: D^T D, `[J, J]`, where it is known already; None: it is computed.
        in_memory: whether D^T y lies in memory rather than in a scratch file.
        ranks: processes among which the texels of the cluster are divided.
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
        correlation[part] = correlations(atoms, signals).to(correlation.device)
        energy[part] = squared_norms(signals)
        own = torch.ones(len(signals)).to(signals) if weight is None else weight[part].to(signals)
        total += (own @ signals.flatten(1)).view_as(total)
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
        gram=atoms @ atoms.T if gram is None else gram,
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
    """`count` and `effective` of `Products`, over all ranks."""
    if weight is None:
        count = int(ranks.sum(torch.tensor(texels)))
        return count, count
    sums = ranks.sum(torch.stack((weight.sum(), weight.square().sum())))
    return float(sums[0]), float(sums[0] ** 2 / sums[1])


def correlations(atoms: Tensor, signals: Tensor) -> Tensor:
    """D^T y `[m, J, C]`, strided, of atoms `[J, D]` and signals `[m, C, D]`.

    The product has the atoms on its left: faster where they are few.
    """
    return (atoms @ signals.flatten(0, 1).T).unflatten(1, signals.shape[:2]).transpose(0, 1)


def squared_norms(signals: Tensor) -> Tensor:
    """||y||^2 `[m, C]` float64 of signals `[m, C, D]`: float64 sums of short float32 runs."""
    even = signals.shape[-1] // RUN * RUN
    runs = signals[..., :even].unflatten(-1, (-1, RUN))  # [m, C, D / RUN, RUN]
    rest = torch.linalg.vector_norm(signals[..., even:], dim=-1).double().square()
    return rest + torch.linalg.vector_norm(runs, dim=-1).double().square().sum(-1)


def _overlap(points: Tensor, centre: Tensor, mean_energy: Tensor) -> Tensor:
    """<y, mean y> of every texel `[n]`, from principal coordinates `[n, P]` and their mean `[P]`.

    The part of y outside of the principal components is nearly orthogonal to the mean of many
    texels; its product with the mean is taken to be the same for all of them.
    """
    return points @ centre + (mean_energy - centre.square().sum())
