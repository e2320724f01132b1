"""Weights of errors, by texel and by direction pair.

The weight of an error is the product of the weights v_t of its texel and w_d of its pair: a fit
minimizes sum_t v_t sum_d w_d (y_td - s_td)^2. As in any weighted least squares, values and lobes
are scaled by sqrt(w_d); v_t is a factor in every sum over texels. Pairs that were not measured have
weight 0.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass

import torch
from torch import Tensor

from ..errors import DataError
from . import BTF

Index = Tensor | slice
# Smallest weight of a texel: even one of weight 0 is in a cluster, with lobes and a residual.
MIN_TEXEL_WEIGHT = 1e-6


@dataclass(frozen=True)
class Weights:
    """Weights of the errors of one BTF, with mean 1.

    Attributes:
        pair: weights of direction pairs, `[D]` float32, 0 where not measured; None: all 1.
        texel: weights of texels, `[T]` float32; None: all 1.
        measured: whether each pair has values, `[D]` bool; None: all have.
    """

    pair: Tensor | None = None
    texel: Tensor | None = None
    measured: Tensor | None = None

    @classmethod
    def build(
        cls,
        btf: BTF,
        pair: Tensor | None = None,
        texel: Tensor | None = None,
        *,
        where: str = "the weights",
    ) -> Weights:
        """Checked weights of any scale.

        Args:
            btf: BTF of the errors; only its header is used.
            pair: weights of pairs `[V, L]`, not negative; None: uniform.
            texel: weights of texels `[H, W]`, not negative, row 0 at the top; None: uniform.
            where: name of the weights in messages.

        Raises:
            DataError: a shape is wrong, a weight is negative or not finite, or all weights of
                measured values are 0.
        """
        measured = btf.measured
        if pair is not None:
            shape = btf.pair_shape
            pair = _checked(pair, shape, f"'pair' of {where}", "[views, lights]").flatten()
        elif measured is not None:
            pair = torch.ones(btf.pair_count, dtype=torch.float64)
        if pair is not None:
            pair = _evened(pair, measured, f"'pair' of {where}")
        if texel is not None:
            shape = (btf.height, btf.width)
            texel = _checked(texel, shape, f"'texel' of {where}", "[height, width]").flatten()
            texel = _evened(texel, None, f"'texel' of {where}")
        return cls(pair, texel, measured)

    def times(self, other: Weights) -> Weights:
        """The products of these weights and others of the same BTF.

        Raises:
            DataError: all products are 0.
        """
        pair = _product(self.pair, other.pair, self.measured)
        return Weights(pair, _product(self.texel, other.texel, None), self.measured)

    def floored(self, fraction: float) -> Weights:
        """Weights of which a fraction, 0 to 1, is spread evenly over all measured values.

        With a fraction above 0, no measured value has weight 0.
        """
        even = fraction if self.measured is None else fraction * self.measured
        pair = None if self.pair is None else (1.0 - fraction) * self.pair + even
        texel = None if self.texel is None else (1.0 - fraction) * self.texel + fraction
        return Weights(pair, texel, self.measured)

    @property
    def uniform(self) -> bool:
        """Whether all weights are 1 and no pair is missing."""
        return self.pair is None and self.texel is None

    def uniform_but_for(self, measured: Tensor | None) -> bool:
        """Whether all weights are 1 but at pairs that are not `measured [D]`."""
        if self.texel is not None:
            return False
        if self.pair is None or measured is None:
            return self.pair is None
        return bool((self.pair == measured).all())

    def scale(self, device: torch.device | str) -> Tensor | None:
        """The scale sqrt(w_d) of every pair, `[D]`; None if all are 1."""
        return None if self.pair is None else self.pair.to(device).sqrt()

    def values(self, btf: BTF, index: Index, device: torch.device | str) -> Tensor:
        """Values `[n, D, C]` of some texels, scaled by sqrt(w_d), on a device."""
        values, scale = btf.texels(index, device), self.scale(device)
        return values if scale is None else values * scale[:, None]

    def signals(self, btf: BTF, index: Index, device: torch.device | str) -> Tensor:
        """Values `[n, C, D]` of some texels, scaled by sqrt(w_d), on a device."""
        values, scale = btf.signals(index, device), self.scale(device)
        return values if scale is None else values * scale

    def of_texels(self, index: Index, device: torch.device | str = "cpu") -> Tensor | None:
        """Positive weights v_t `[n]` of some texels, on a device; None if all are 1."""
        return (
            None if self.texel is None else self.texel[index].clamp(min=MIN_TEXEL_WEIGHT).to(device)
        )

    def digest(self) -> str | None:
        """The hash of the weights, in hexadecimal; None for uniform weights."""
        parts = [part for part in (self.pair, self.texel) if part is not None]
        if not parts:
            return None
        digest = hashlib.blake2b(digest_size=16)
        for part in parts:
            digest.update(part.numpy().tobytes())
        return digest.hexdigest()


UNIFORM = Weights()


def _checked(values: Tensor, shape: tuple[int, int], what: str, axes: str) -> Tensor:
    """The values `[H, W]` or `[V, L]` in float64, of the given shape, finite and not negative."""
    if tuple(values.shape) != shape:
        raise DataError(
            f"{what} has shape {list(values.shape)}; expected {list(shape)} = {axes} of the BTF; "
            f"make the two agree."
        )
    if not values.is_floating_point():
        raise DataError(f"{what} has type {values.dtype}; expected floats; convert it.")
    bad = ~(values.isfinite() & (values >= 0.0))
    if bool(bad.any()):
        row, column = bad.nonzero()[0].tolist()
        raise DataError(
            f"{what} holds {float(values[row, column])} at [{row}, {column}]; expected finite "
            f"weights that are not negative; mend that value."
        )
    return values.double()


def _evened(weights: Tensor, measured: Tensor | None, what: str) -> Tensor:
    """Weights `[N]` scaled to mean 1 over the measured ones; 0 at the others."""
    if measured is not None:
        weights = weights * measured
    count = len(weights) if measured is None else int(measured.sum())
    total = float(weights.sum())
    if total <= 0.0:
        raise DataError(
            f"{what} is 0 wherever something was measured; expected at least one weight above "
            f"zero; mend the weights."
        )
    return (weights * (count / total)).float()


def _product(first: Tensor | None, second: Tensor | None, measured: Tensor | None) -> Tensor | None:
    """Products `[N]` of two weights, scaled to mean 1; None stands for uniform weights."""
    if first is None or second is None:
        return second if first is None else first
    return _evened(first.double() * second.double(), measured, "the product of all weights")
