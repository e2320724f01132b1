"""The residual at a place of the texture, of clusters and of rank R, between measured pairs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Protocol

from .arrays import loop, row
from .hemisphere import Pairs
from .libraries import dr, mi

# Most components whose functions are read at once.
WIDTH = 16
# Signed bytes of a word, and words that are read at once.
BYTES, WORDS = 4, 4
# Value of the least step of a byte that stands highest in its word.
TOP_STEP = 2.0**24


class Residual(Protocol):
    """A residual of one kind."""

    def mixed(self, block: Any, weights: Sequence[Any]) -> tuple[Any, ...]:
        """What `of_view` needs of a block whose texels have bilinear weights."""
        ...

    def of_view(self, view: Any, mixed: Sequence[Any]) -> Sequence[Any]:
        """What `at` needs of a measured view."""
        ...

    def at(self, pair: Any, seen: Sequence[Any]) -> list[Any]:
        """RGB at a measured pair of that view."""
        ...


@dataclass(frozen=True)
class Clusters:
    """One function a cluster.

    Attributes:
        values: `[K * D, 4]`, RGB and a number that is not used.
        labels: clusters of the n texels of each block, `[T, n]`.
        pairs: D.
    """

    values: Any
    labels: Any
    pairs: int

    def mixed(self, block: Any, weights: Sequence[Any]) -> tuple[Any, ...]:
        """The first pairs of the clusters of a block, and the weights of its texels."""
        labels = row(self.labels, block, len(weights))
        return *(label * self.pairs for label in labels), *weights

    def of_view(self, view: Any, mixed: Sequence[Any]) -> Sequence[Any]:
        """The same for all views."""
        return mixed

    def at(self, pair: Any, seen: Sequence[Any]) -> list[Any]:
        """RGB at a measured pair."""
        texels = len(seen) // 2
        texels = zip(seen[:texels], seen[texels:], strict=True)
        rows = [(row(self.values, first + pair, 4), weight) for first, weight in texels]
        return [sum(weight * values[c] for values, weight in rows) for c in range(3)]


@dataclass(frozen=True)
class RankResidual:
    """Functions that all texels share, and coefficients of each.

    Attributes:
        functions: `[D, C, R']` with R' >= R, a multiple of `width`.
        coefficients: of the texels, `[T, R']`.
        corners: texels of each block, `[T, n]`.
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
        for texel, weight in zip(row(self.corners, block, len(weights)), weights, strict=True):
            numbers = self.numbers(self.coefficients, texel)
            total = [t + weight * n for t, n in zip(total, numbers, strict=True)]
        return tuple(total)

    def of_view(self, view: Any, mixed: Sequence[Any]) -> Sequence[Any]:
        """The same for all views."""
        return mixed

    def at(self, pair: Any, seen: Sequence[Any]) -> list[Any]:
        """RGB at a measured pair."""
        rows = (self.numbers(self.functions, 3 * pair + c) for c in range(3))
        return [sum(n * m for n, m in zip(numbers, seen, strict=True)) for numbers in rows]

    def numbers(self, table: Any, index: Any) -> list[Any]:
        """The R' numbers of a row."""
        return long_row(table, index, self.rank, self.width)


@dataclass(frozen=True)
class ByteResidual(RankResidual):
    """The same where functions are signed bytes: a quarter of the memory, and of the reads.

    Attributes:
        functions: four bytes a word, `[D, W]` with W * 4 >= 3 * R', a multiple of `WORDS`.
        scales: what the bytes of a view are multiplied by, over TOP_STEP, `[V, R']`.
        words: W.
    """

    scales: Any
    words: int

    def of_view(self, view: Any, mixed: Sequence[Any]) -> Sequence[Any]:
        """The coefficients times the scales of a view."""
        scales = self.numbers(self.scales, view)
        return [scale * number for scale, number in zip(scales, mixed, strict=True)]

    def at(self, pair: Any, seen: Sequence[Any]) -> list[Any]:
        """RGB at a measured pair."""
        words = long_row(self.functions, pair, self.words, WORDS)
        numbers = [number for word in words for number in _bytes(word)]
        starts = range(0, 3 * self.rank, self.rank)
        return [
            sum(n * m for n, m in zip(numbers[start : start + self.rank], seen, strict=True))
            for start in starts
        ]


def long_row(table: Any, index: Any, count: int, width: int) -> list[Any]:
    """Row `index` of a table of `count` numbers a row, of which `width` are read at once."""
    blocks = count // width
    parts = (row(table, blocks * index + n, width) for n in range(blocks))
    return [number for part in parts for number in part]


def _bytes(word: Any) -> list[Any]:
    """The four signed bytes of a word, each times TOP_STEP: this saves a shift to extend signs."""
    top = 0xFF000000
    raised = (word << 24, (word << 16) & top, (word << 8) & top, word & top)
    return [mi.Float(dr.reinterpret_array(mi.Int32, each)) for each in raised]


def epsilon(kinds: Sequence[Residual], block: Any, weights: Sequence[Any], pairs: Pairs) -> Any:
    """The whole residual, RGB, of a block whose texels have weights, between measured `pairs`."""
    mixed = [kind.mixed(block, weights) for kind in kinds]
    ends = [sum(map(len, mixed[:n])) for n in range(len(kinds) + 1)]

    def add(n: Any, *state: Any) -> tuple[Any, ...]:
        total, given, rest = list(state[:3]), state[3 : 3 + Pairs.PARTS], state[3 + Pairs.PARTS :]
        near = pairs.with_parts(given)
        for kind, first, last in zip(kinds, ends, ends[1:], strict=False):
            seen = kind.of_view(near.view[0], rest[first:last])
            for pair, weight in near.of_first_view():
                values = kind.at(pair, seen)
                total = [t + weight * value for t, value in zip(total, values, strict=True)]
        return n + 1, *total, *near.turned().parts(), *rest

    zeros = (mi.Float(0.0) for _ in range(3))
    start = (mi.UInt32(0), *zeros, *pairs.parts(), *(number for part in mixed for number in part))
    return mi.Color3f(*loop(start, lambda n, *_: n < Pairs.VIEWS, add)[1:4])
