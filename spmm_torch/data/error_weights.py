"""Weights of texels and of direction pairs: how much an error there counts.

A value counts by the product of the weights of its texel and of its pair, so the whole fit
minimizes sum_t v_t sum_d w_d (y_td - s_td)^2. Pair weights scale values and lobes by sqrt(w_d), as
in any weighted least squares, and all else stays as it is; texel weights count in every sum over
texels. Pairs that were not measured have weight 0.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass

import torch
from torch import Tensor

from ..errors import DataError
from . import BTF

Index = Tensor | slice
# Texels without weight count this much: they still are in a cluster, with lobes and a residual.
LEAST_TEXEL = 1e-6


@dataclass(frozen=True)
class Weights:
    """Weights of the values of one BTF; of mean 1, so that they change no scale.

    Attributes:
        pair: `[D]` float32, 0 where nothing was measured; None: 1 for all.
        texel: `[T]` float32; None: 1 for all.
        measured: which pairs have values, `[D]` bool; None: all.
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
            btf: whose values they weigh; only its header is looked at.
            pair: `[V, L]`, not negative; None: all the same.
            texel: `[H, W]`, not negative, row 0 at the top; None: all the same.
            where: how messages call them.

        Raises:
            DataError: wrong shape, not finite, negative, or nothing that was measured counts.
        """
        measured = btf.measured
        if pair is not None:
            shape = (len(btf.view), len(btf.light))
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
        """The products of both, for the same BTF.

        Raises:
            DataError: they have nothing in common.
        """
        pair = _product(self.pair, other.pair, self.measured)
        return Weights(pair, _product(self.texel, other.texel, None), self.measured)

    def floored(self, share: float) -> Weights:
        """The same with a `share`, 0 to 1, of the weight spread evenly over what was measured.

        With more than 0, nothing that was measured has weight 0.
        """
        even = share if self.measured is None else share * self.measured
        pair = None if self.pair is None else (1.0 - share) * self.pair + even
        texel = None if self.texel is None else (1.0 - share) * self.texel + share
        return Weights(pair, texel, self.measured)

    @property
    def uniform(self) -> bool:
        """Whether all values count alike and none is missing."""
        return self.pair is None and self.texel is None

    def scale(self, device: torch.device | str) -> Tensor | None:
        """sqrt(w_d) of every pair, `[D]`; None if they are all 1."""
        return None if self.pair is None else self.pair.to(device).sqrt()

    def signals(self, btf: BTF, index: Index, device: torch.device | str) -> Tensor:
        """Values `[n, C, D]` of some texels, channels first, scaled by sqrt(w_d)."""
        values, scale = btf.signals(index, device), self.scale(device)
        return values if scale is None else values * scale

    def of_texels(self, index: Index, device: torch.device | str = "cpu") -> Tensor | None:
        """v_t of some texels, `[n]`, positive; None if they are all 1."""
        return None if self.texel is None else self.texel[index].clamp(min=LEAST_TEXEL).to(device)

    def digest(self) -> str | None:
        """A name of these very weights; None for uniform ones."""
        parts = [part for part in (self.pair, self.texel) if part is not None]
        if not parts:
            return None
        digest = hashlib.blake2b(digest_size=16)
        for part in parts:
            digest.update(part.numpy().tobytes())
        return digest.hexdigest()


UNIFORM = Weights()


def _checked(values: Tensor, shape: tuple[int, int], what: str, axes: str) -> Tensor:
    """The values in float64, of one shape, finite and not negative."""
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
    """Weights `[N]` of mean 1 over what was measured."""
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
    if first is None or second is None:
        return second if first is None else first
    return _evened(first.double() * second.double(), measured, "the product of all weights")
