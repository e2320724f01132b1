"""The residual at a place of the texture, of clusters and of rank R, between measured pairs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from .arrays import loop, row
from .hemisphere import Pairs
from .libraries import mi

# Most components whose functions are read at once.
WIDTH = 16


@dataclass(frozen=True)
class Clusters:
    """One function a cluster.

    Attributes:
        values: `[K * D, 4]`, RGB and a number that is not used.
        labels: clusters of the four texels of each block, `[T, 4]`.
        pairs: D.
    """

    values: Any
    labels: Any
    pairs: int

    def mixed(self, block: Any, weights: Sequence[Any]) -> tuple[Any, ...]:
        """What `at` needs of a block whose texels have bilinear weights."""
        return *(label * self.pairs for label in row(self.labels, block, 4)), *weights

    def at(self, pair: Any, mixed: Sequence[Any]) -> list[Any]:
        """RGB at a measured pair."""
        texels = zip(mixed[:4], mixed[4:], strict=True)
        rows = [(row(self.values, first + pair, 4), weight) for first, weight in texels]
        return [sum(weight * values[c] for values, weight in rows) for c in range(3)]


@dataclass(frozen=True)
class RankResidual:
    """Functions that all texels share, and coefficients of each.

    Attributes:
        functions: `[D, C, R']` with R' >= R, a multiple of `width`.
        coefficients: of the texels, `[T, R']`.
        corners: texels of each block, `[T, 4]`.
        rank: R'.
        width: components that are read at once.
    """

    functions: Any
    coefficients: Any
    corners: Any
    rank: int
    width: int

    def mixed(self, block: Any, weights: Sequence[Any]) -> tuple[Any, ...]:
        """The coefficients of a block whose texels have bilinear weights."""
        total = [mi.Float(0.0)] * self.rank
        for texel, weight in zip(row(self.corners, block, 4), weights, strict=True):
            numbers = self._row(self.coefficients, texel)
            total = [t + weight * n for t, n in zip(total, numbers, strict=True)]
        return tuple(total)

    def at(self, pair: Any, mixed: Sequence[Any]) -> list[Any]:
        """RGB at a measured pair."""
        rows = (self._row(self.functions, 3 * pair + c) for c in range(3))
        return [sum(n * m for n, m in zip(numbers, mixed, strict=True)) for numbers in rows]

    def _row(self, table: Any, index: Any) -> list[Any]:
        """The R' numbers of a row."""
        blocks = self.rank // self.width
        parts = (row(table, blocks * index + n, self.width) for n in range(blocks))
        return [number for part in parts for number in part]


def epsilons(
    kinds: Sequence[Clusters | RankResidual],
    block: Any,
    weights: Sequence[Any],
    pairs: Sequence[Pairs],
) -> list[Any]:
    """The whole residual, RGB, of a block whose texels have bilinear weights.

    Args:
        kinds: residuals of the model.
        block, weights: the place.
        pairs: one or more queries of one view.
    """
    mixed = [kind.mixed(block, weights) for kind in kinds]
    ends = [sum(map(len, mixed[:n])) for n in range(len(kinds) + 1)]
    sums = 3 * len(pairs)

    def add(n: Any, *state: Any) -> tuple[Any, ...]:
        total, given = list(state[:sums]), state[sums:]
        for query in range(len(pairs)):
            parts = given[Pairs.PARTS * query : Pairs.PARTS * (query + 1)]
            pair, weight = Pairs.of_parts(parts).of(n)
            rest = given[Pairs.PARTS * len(pairs) :]
            for kind, first, last in zip(kinds, ends, ends[1:], strict=False):
                for c, value in enumerate(kind.at(pair, rest[first:last])):
                    total[3 * query + c] += weight * value
        return n + 1, *total, *given

    zeros = (mi.Float(0.0) for _ in range(sums))
    given = (number for each in pairs for number in each.parts())
    start = (mi.UInt32(0), *zeros, *given, *(number for part in mixed for number in part))
    state = loop(start, lambda n, *_: n < Pairs.COUNT, add)[1 : 1 + sums]
    return [mi.Color3f(*state[3 * n : 3 * n + 3]) for n in range(len(pairs))]
