"""Stage residual: the residual of a cluster as it is stored, and the squared errors of its fit."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from ...metrics import Totals
from ...model.residual import decode_residual, encode_residual
from ...runtime.ranks import Ranks
from ..select.texels import Fit, Products, squared_errors
from .missing import MissingPairs

Blocks = list[tuple[slice, Fit]]


@dataclass(frozen=True)
class Tally:
    """What a fit leaves.

    Attributes:
        code: the stored residual `[D, C]`.
        scale: its scale `[]`.
        totals: squared errors over all measured values, alike.
        weighted: the same by weight; None where all weights are 1.
    """

    code: Tensor
    scale: Tensor
    totals: Totals
    weighted: Totals | None = None


def tally_uniform(
    products: Products,
    atoms: Tensor,
    mean: Tensor,
    errors: tuple[float, float],
    precision: torch.dtype,
    ranks: Ranks,
) -> Tally:
    """Where all values count alike: the residual takes away all that a mean can.

    Args:
        products: of the texels.
        atoms: `[J, D]`.
        mean: weight of every atom, mean over the cluster, `[J, C]`.
        errors: squared error of the lobes alone, and how much of it the mean error takes away.
        precision: in which the residual is stored.
        ranks: that share the cluster.
    """
    residual = products.mean - atoms.T @ mean.to(atoms.dtype)  # [D, C]
    code, scale = encode_residual(residual[None], precision)
    rounding = (decode_residual(code, scale)[0] - residual).double().square().sum()
    energy = float(ranks.sum(products.energy.sum()))
    without, taken = errors
    totals = Totals(
        energy=energy,
        without_residual=without,
        with_residual=max(without - taken, 0.0) + products.count * float(rounding),
        cluster_mean=energy - products.count * float(products.mean_energy.sum()),
    )
    return Tally(code[0].cpu(), scale[0].cpu(), totals)


@dataclass(frozen=True)
class WeightedTally:
    """Where values count by weight.

    At each pair the weighted errors are least for the mean error of the texels by their weights,
    whatever the weight of the pair.

    Attributes:
        products, atoms: scaled by the weights.
        plain, raw: the same without weights, missing pairs being 0 in `plain` only.
        scale: square roots of the weights of the pairs, `[D]`; None: 1.
        measured: `[D]` bool; None: all pairs.
        gaps: how missing pairs are filled; None without any.
    """

    products: Products
    atoms: Tensor
    plain: Products
    raw: Tensor
    scale: Tensor | None
    measured: Tensor | None
    gaps: MissingPairs | None

    def tally(self, mean: Tensor, blocks: Blocks, precision: torch.dtype, ranks: Ranks) -> Tally:
        """The residual beside lobes of `mean [J, C]` weights, and the errors of all `blocks`."""
        residual = self._mean_value() - self.raw.T @ mean.to(self.raw.dtype)  # [D, C]
        if self.gaps is not None:
            residual = self.gaps.filled(residual)
        code, scale = encode_residual(residual[None], precision)
        stored = decode_residual(code, scale)[0]
        seen = stored if self.measured is None else stored * self.measured[:, None]
        scaled = stored if self.scale is None else stored * self.scale[:, None]
        raw = self.raw if self.measured is None else self.raw * self.measured
        totals = _totals(self.plain, raw, blocks, seen, ranks)
        weighted = _totals(self.products, self.atoms, blocks, scaled, ranks)
        return Tally(code[0].cpu(), scale[0].cpu(), totals, weighted)

    def _mean_value(self) -> Tensor:
        """The mean of the texels by their weights, without the weights of pairs: `[D, C]`."""
        if self.scale is None:
            return self.products.mean
        scale = self.scale[:, None]
        mean = self.products.mean / torch.where(scale > 0.0, scale, 1.0)
        return torch.where(scale > 0.0, mean, self.plain.mean)


def _totals(
    products: Products, atoms: Tensor, blocks: Blocks, residual: Tensor, ranks: Ranks
) -> Totals:
    """Squared errors of fits and a residual `[D, C]` that were made for other weights."""
    total = products.mean_correlation.new_zeros(len(atoms), residual.shape[1]).double()
    own = torch.zeros((), dtype=torch.float64)
    for texels, fit in blocks:
        part = products.part(texels)
        total += fit.total_weights(len(atoms), part.importance)
        own += float(part.total(squared_errors(part, fit)))
    without = float(ranks.sum(own))
    mean = ranks.sum(total) / products.count  # [J, C]
    left = (products.mean - atoms.T @ mean.to(atoms.dtype)).double()  # the mean error, [D, C]
    # sum (e - r)^2 = sum e^2 - 2 r sum e + N r^2
    change = (residual.double() * (residual.double() - 2.0 * left)).sum()
    energy = float(ranks.sum(products.total(products.energy)))
    return Totals(
        energy=energy,
        without_residual=without,
        with_residual=max(without + products.count * float(change), 0.0),
        cluster_mean=energy - products.count * float(products.mean_energy.sum()),
    )
