"""Stage residual: the stored residual of a cluster, and the squared errors of its fit."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from ...metrics import Totals
from ...model.residual import decode_residual, encode_residual
from ...runtime.ranks import Ranks
from ..select.products import Products
from ..select.texels import Fit, squared_errors
from .missing import MissingPairs

Blocks = list[tuple[slice, Fit]]


@dataclass(frozen=True)
class ClusterErrors:
    """The stored residual of a cluster, and the errors of its fit.

    Attributes:
        code: the stored residual `[D, C]`.
        scale: its scale `[]`.
        totals: squared errors over all measured values.
        weighted: the same with the weights of the values; None where these are all 1.
    """

    code: Tensor
    scale: Tensor
    totals: Totals
    weighted: Totals | None = None

    def stored(self) -> Tensor:
        """The values of the residual as stored, `[D, C]`."""
        return decode_residual(self.code[None], self.scale[None])[0]


def uniform_errors(
    products: Products,
    atoms: Tensor,
    mean: Tensor,
    errors: tuple[float, float],
    precision: torch.dtype,
    ranks: Ranks,
) -> ClusterErrors:
    """Errors where all weights are 1: the residual is then the mean error of the texels.

    Args:
        products: of the texels.
        atoms: `[J, D]`.
        mean: weight of every atom, mean over the cluster, `[J, C]`.
        errors: squared error of the lobes alone, and the part that the residual takes away.
        precision: type of the stored residual.
        ranks: processes among which the cluster is divided.
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
    return ClusterErrors(code[0].cpu(), scale[0].cpu(), totals)


@dataclass(frozen=True)
class WeightedErrors:
    """Errors where values have weights.

    At each pair the best residual is the mean error by the weights of the texels; the weight of the
    pair does not matter.

    Attributes:
        products, atoms: products and atoms `[J, D]`, scaled by the weights of the pairs.
        plain, raw: the same without weights; missing pairs are 0 in `plain` only.
        scale: square roots of the weights of the pairs, `[D]`; None: 1.
        measured: whether a pair was measured, `[D]` bool; None: all were.
        gaps: the pairs that were not; None: all were.
    """

    products: Products
    atoms: Tensor
    plain: Products
    raw: Tensor
    scale: Tensor | None
    measured: Tensor | None
    gaps: MissingPairs | None

    def of_fit(
        self, mean: Tensor, blocks: Blocks, precision: torch.dtype, ranks: Ranks
    ) -> ClusterErrors:
        """The stored residual and the errors of a fit.

        Args:
            mean: weight of every atom, mean over the cluster, `[J, C]`.
            blocks: texels of this rank and their fits.
            precision: type of the stored residual.
            ranks: processes among which the cluster is divided.
        """
        residual = self._mean_value() - self.raw.T @ mean.to(self.raw.dtype)  # [D, C]
        if self.gaps is not None:
            residual = self.gaps.filled(residual)
        code, scale = encode_residual(residual[None], precision)
        stored = decode_residual(code, scale)[0]
        seen, scaled = self.seen(stored.T).T, self.scaled(stored.T).T
        totals = _totals(self.plain, self.seen(self.raw), blocks, seen, ranks)
        weighted = _totals(self.products, self.atoms, blocks, scaled, ranks)
        return ClusterErrors(code[0].cpu(), scale[0].cpu(), totals, weighted)

    def seen(self, values: Tensor) -> Tensor:
        """Values `[..., D]` at measured pairs, 0 at others."""
        return values if self.measured is None else values * self.measured

    def scaled(self, values: Tensor) -> Tensor:
        """Values `[..., D]` times the square roots of the weights of their pairs."""
        return values if self.scale is None else values * self.scale

    def _mean_value(self) -> Tensor:
        """Mean of the texels by their weights, without the weights of the pairs, `[D, C]`."""
        if self.scale is None:
            return self.products.mean
        scale = self.scale[:, None]
        mean = self.products.mean / torch.where(scale > 0.0, scale, 1.0)
        return torch.where(scale > 0.0, mean, self.plain.mean)


def _totals(
    products: Products, atoms: Tensor, blocks: Blocks, residual: Tensor, ranks: Ranks
) -> Totals:
    """Squared errors of fits with any residual `[D, C]`, not only the mean error."""
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
