"""Errors of compressed values, and the weights of squared errors that come near them."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from ...data import BTF
from ...data.error_weights import Weights

# Minus the exponent of g'(y)^2: y^(1/3) has 2 (1 - 1/3), log(y) has 2.
CUBE_ROOT, LOG = 4.0 / 3.0, 2.0
EXPONENTS = {"cube-root": CUBE_ROOT, "log": LOG}


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

    def weights(self, btf: BTF) -> Weights:
        """The weights of squared errors."""
        pair = self.curvature(self.size)
        if self.pair is not None:
            pair = pair * self.pair
        return Weights.build(btf, pair.view(btf.pair_shape))


def own_units(values: Tensor) -> Tensor:
    """Root mean squares `[n, 1, 1]` of values `[n, C, D]`, 1 of black ones."""
    size = values.double().square().mean((1, 2), keepdim=True).sqrt().to(values)
    return torch.where(size > 0.0, size, 1.0)
