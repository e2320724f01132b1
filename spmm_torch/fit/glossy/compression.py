"""Errors of compressed values, and the weights of squared errors that come near them."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from ...data import BTF
from ...data.error_weights import Weights
from .views import BY_VIEW, view_weights

# Minus the exponent of g'(y)^2: y^(1/3) has 2 (1 - 1/3), log(y) has 2.
CUBE_ROOT, LOG = 4.0 / 3.0, 2.0
EXPONENTS = {"cube-root": CUBE_ROOT, "log": LOG}
L2, BALANCED = "l2", "balanced"
# Fraction of the typical value that is added to all values: darker ones count as black.
DARK = 0.1
# Least part of the mean that is typical of scattered samples.
LEAST_TYPICAL = 1e-3


@dataclass(frozen=True)
class Compression:
    """What is made of values before their errors are squared.

    The error of a value s in place of y is q (a (y - s)^2 + b (g(y) - g(s))^2), and its weight
    q (a + b g'^2) at the mean value of the pair.

    Attributes:
        exponent: of g'(y)^2 = (y + dark)^-exponent.
        dark: value that is added to all.
        plain, seen: a and b.
        size: mean values of the pairs, at least 0, `[D]` float64.
        pair: factors q of the pairs, `[D]`; None: 1.
        apart: whether texels are unrelated materials, so that values are in units of their own.
    """

    exponent: float
    dark: float
    plain: float
    seen: float
    size: Tensor
    pair: Tensor | None
    apart: bool = False

    @classmethod
    def of(
        cls,
        error: str,
        size: Tensor,
        measured: Tensor,
        views: int,
        pair: Tensor | None = None,
        *,
        apart: bool = False,
        listed: bool = False,
    ) -> Compression:
        """What errors of a name make of values.

        Args:
            error: l2, by-view, balanced, cube-root or log.
            size: mean values of the pairs, 0 where not measured, `[D]` float64.
            measured: `[D]` bool.
            views: number of views.
            pair: factors of the pairs, `[D]`; None: 1.
            apart: as in the class.
            listed: whether samples are scattered.
        """
        size = size.clamp(min=0.0)
        dark = float(DARK * _typical(size[measured], listed))
        plain, seen = 0.0, 1.0
        if error in (L2, BY_VIEW):
            plain, seen = 1.0, 0.0
        if error == BY_VIEW:
            pair = view_weights(size, measured, views)
        if error == BALANCED:
            plain = float(1.0 / size[measured].square().sum())
            seen = float(1.0 / (9.0 * (size[measured] + dark).pow(2.0 / 3.0).sum()))
        exponent = EXPONENTS.get(error, CUBE_ROOT)
        return cls(exponent, dark, plain, seen, size, pair, apart)

    def curvature(self, values: Tensor) -> Tensor:
        """a + b g'^2 at values at least 0, `[...]`."""
        return self.plain + self.seen * (values + self.dark) ** -self.exponent

    def compressed(self, values: Tensor) -> Tensor:
        """g of values `[...]`, of which those under 0 are black."""
        bright = values.clamp(min=0.0) + self.dark
        if self.exponent == LOG:
            return bright.log()
        power = 1.0 - 0.5 * self.exponent
        return bright**power / power

    def units(self, values: Tensor) -> Tensor:
        """The units `[n, 1, 1]` in which values `[n, C, D]` of some texels count."""
        return own_units(values) if self.apart else values.new_ones(len(values), 1, 1)

    def pair_weights(self) -> Tensor:
        """The weights of squared errors, `[D]` float64."""
        pair = self.curvature(self.size)
        return pair if self.pair is None else pair * self.pair

    def weights(self, btf: BTF) -> Weights:
        """The same for a BTF, of mean 1."""
        return Weights.build(btf, self.pair_weights().view(btf.pair_shape))


def own_units(values: Tensor) -> Tensor:
    """Root mean squares `[n, 1, 1]` of values `[n, C, D]`, 1 of black ones."""
    size = values.double().square().mean((1, 2), keepdim=True).sqrt().to(values)
    return torch.where(size > 0.0, size, 1.0)


def _typical(size: Tensor, listed: bool) -> Tensor:
    """The typical one of mean values of pairs `[D]`: the cube of the mean of their cube roots.

    Scattered samples may lie densely about a highlight, which would make it typical: there it is
    the lower quartile, unless most samples are as good as black.
    """
    mean = size.pow(1.0 / 3.0).mean() ** 3
    if not listed:
        return mean
    return size.kthvalue(1 + len(size) // 4).values.clamp(min=LEAST_TYPICAL * float(mean))
