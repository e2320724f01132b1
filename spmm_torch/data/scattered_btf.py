"""Scattered samples: texels that were measured under lists of pairs of directions, without a grid.

Texels share a list, or each has its own. What needs a grid of lights and views, such as pictures
of one pair, is refused in one sentence; what needs samples only goes list by list.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import NoReturn

import numpy as np
import torch
from numpy.typing import ArrayLike
from torch import Tensor

from ..errors import DataError
from ..geometry.relief import HeightField
from .arrays import array_hash
from .btf import BTF, PEAK_FRACTION
from .directions import SAME_DIRECTION, unit_directions
from .kept import chosen, kept_names
from .options import ReadOptions
from .pair_lists import PairList
from .percentile import percentile
from .store import Loading, Part, Progress, Store, check_not_black

# Directions that stand for all: how many, and among how many they are sought.
STANDING, CANDIDATES = 81, 1 << 14


@dataclass(eq=False)
class ScatteredBTF(BTF):
    """Texels under lists of pairs.

    `view` and `light` are some directions of the lists, which stand for all: the lowest ones, and
    others spread over the rest. A model keeps them.

    Args:
        raw: the lists as the source has them; each texel is in one.
    """

    raw: tuple[PairList, ...] = field(default=(), repr=False)
    _lists: tuple[PairList, ...] | None = field(default=None, init=False, repr=False)

    @classmethod
    def from_samples(
        cls,
        wi: ArrayLike,
        wo: ArrayLike,
        values: ArrayLike,
        *,
        name: str = "samples",
        negative: str = "refuse",
    ) -> ScatteredBTF:
        """A BTF of T texels that are no neighbours, under one list of pairs.

        Args:
            wi, wo: unit vectors of the pairs, `[D, 3]`, pointing away from the surface.
            values: linear cosine-weighted values `[T, D, 3]`.
            name: short name of the material.
            negative: treatment of values below zero, as in `ReadOptions`.

        Raises:
            ConfigError: `negative` is not known.
            DataError: shapes do not agree, or a value or direction is not valid.
        """
        where, options = f"the samples {name!r}", ReadOptions(negative=negative)
        light, view = (
            unit_directions(torch.as_tensor(np.asarray(side)), f"{key!r} of {where}")
            for key, side in (("wi", wi), ("wo", wo))
        )
        shown = torch.as_tensor(np.asarray(values)).float()
        if shown.shape[1:] != (len(light), 3) or len(view) != len(light) or not len(shown):
            raise DataError(
                f"{where} have values {list(shown.shape)} at {len(light)} lights and {len(view)} "
                f"views; expected [T, D, 3] at D lights and D views; make them agree."
            )
        if not shown.isfinite().all():
            raise DataError(f"{where} hold a value that is not finite; expected numbers; mend it.")
        count = len(shown)
        parts = (PairList(torch.arange(count), light, view, shown),)
        ends = spread_directions(view), spread_directions(light)
        made = cls(name, "", 1, count, *ends, 4, no_store, hdr=None, raw=parts)
        made.names = tuple(f"texel {index}" for index in range(count))
        made.content = lambda: [array_hash(each.numpy()) for each in (light, view, shown)]
        return replace(made, negative=options.negative, read_as=options.settings()).load()

    @property
    def lists(self) -> tuple[PairList, ...]:
        """The lists, checked and cosine-weighted."""
        self.load()
        assert self._lists is not None
        return self._lists

    def load(
        self,
        progress: Progress | None = None,
        *,
        memory: int | None = None,
        cache: Path | None = None,
    ) -> ScatteredBTF:
        """Checks the values and multiplies them by the cosine where they are without it; itself.

        Args:
            progress: called with (1, 1) at the end.
            memory, cache: not used; values are in memory.

        Raises:
            DataError: a value is negative, or all are 0.
        """
        if self._lists is None:
            self._lists = tuple(self._prepared(part) for part in self.raw)
            check_not_black(self.level(), self.path or self.name)
            if progress is not None:
                progress(1, 1)
        return self

    def _prepared(self, part: PairList) -> PairList:
        values = part.values
        if self.negative == "refuse" and float(values.min()) < 0.0:
            row, pair, channel = torch.nonzero(values < 0.0)[0].tolist()
            raise DataError(
                f"{self.path or self.name} holds {float(values[row, pair, channel]):g} at "
                f"{self._texel(int(part.texels[row]))}, {_place(part, pair)}; expected values that "
                f"are not negative; if they are noise, give data.negative as clip or keep (--set, "
                f"or FitConfig), or negative= of load_btf."
            )
        if self.negative == "clip":
            values = values.clamp(min=0.0)
        if self.cosine_missing:
            values = values * part.wi[:, 2:]
        return replace(part, values=values)

    def _texel(self, texel: int) -> str:
        return f"texel {texel}" if self.names is None else repr(self.names[texel])

    @property
    def pair_shape(self) -> tuple[int, int]:
        """(1, D) of the longest list."""
        return 1, max(len(part.wi) for part in self.raw)

    @property
    def value_count(self) -> int:
        """The number of values of all texels."""
        return sum(part.values.numel() for part in self.raw)

    @property
    def is_hdr(self) -> bool:
        """Whether a value exceeds 1."""
        return self.level() > 1.0

    def level(self) -> float:
        """The highest value."""
        return max(float(part.values.max()) for part in self.lists)

    def peak(self) -> float:
        """The peak of the PSNR, as `BTF.peak`."""
        if not self.is_hdr:
            return 1.0
        chunks = (part.values for part in self.lists)
        return percentile(chunks, self.value_count, PEAK_FRACTION)

    def brightest(self) -> tuple[str, float]:
        """Where the highest value is, in words, and the value."""
        part = max(self.lists, key=lambda part: float(part.values.max()))
        value = part.values.max()
        row, pair, _ = torch.nonzero(part.values == value)[0].tolist()
        return f"{self._texel(int(part.texels[row]))}, {_place(part, pair)}", float(value)

    def samples(self, texel: int) -> tuple[Tensor, Tensor, Tensor]:
        """Lights `[N, 3]`, views `[N, 3]` and values `[N, C]` of what was measured of a texel."""
        for part in self.lists:
            row = torch.nonzero(part.texels == texel).flatten()
            if len(row):
                return part.wi, part.wo, part.values[int(row[0])]
        raise IndexError(f"texel {texel} of {self.texel_count}")

    def scaled(self, factor: float) -> ScatteredBTF:
        """The same with values times a factor, cosines included; 1: itself."""
        if factor == 1.0:
            return self
        parts = tuple(part.scaled(factor) for part in self.lists)
        return replace(self, raw=parts, cosine_missing=False, negative="keep")

    def restricted(
        self,
        texels: Tensor | None = None,
        size: tuple[int, int] | None = None,
        *,
        views: Tensor | None = None,
        lights: Tensor | None = None,
    ) -> ScatteredBTF:
        """Some of the texels; see `BTF.restricted`.

        Raises:
            DataError: directions are chosen, of which there are only those of the lists.
        """
        if views is not None or lights is not None:
            self._refuse("a choice of views and lights")
        if texels is None:
            return self
        height, width = size or (self.height, self.width)
        place = torch.full((self.texel_count,), -1)
        place[texels] = torch.arange(len(texels))
        part = replace(self.part, texels=chosen(self.part.texels, texels))
        names, raw = kept_names(self.names, texels), tuple(_kept(self.raw, place))
        return replace(self, height=height, width=width, part=part, names=names, raw=raw)

    def _refuse(self, what: str) -> NoReturn:
        raise DataError(
            f"{self.path or self.name} holds scattered samples, and {what} needs a grid of lights "
            f"and views; expected samples of every view under every light; interpolate them on a "
            f"grid and save that as NPZ."
        )

    def store(self) -> Store:
        """Refused, as all that reads values by pairs of a grid.

        Raises:
            DataError: always.
        """
        self._refuse("this")

    def pairs(self) -> tuple[Tensor, Tensor]:
        """Refused: texels may have other pairs; there are no `[D, 3]` for all.

        Raises:
            DataError: always.
        """
        self._refuse("this")

    def aligned(self, field: HeightField, drift: Tensor | None = None) -> BTF:
        """Refused, with any `field` and `drift [V, 2]`: a relief is seen in pictures.

        Raises:
            DataError: always.
        """
        self._refuse("a relief")


def _place(part: PairList, pair: int) -> str:
    """A pair in words."""
    wi, wo = (", ".join(f"{x:.4g}" for x in side[pair].tolist()) for side in (part.wi, part.wo))
    return f"light ({wi}), view ({wo})"


def _kept(lists: tuple[PairList, ...], place: Tensor) -> Iterator[PairList]:
    """The lists of the texels that have a new place, `place [T]`; -1 for none."""
    for part in lists:
        own = place[part.texels]
        order = torch.argsort(own)[int((own < 0).sum()) :]
        if len(order):
            yield replace(part, texels=own[order], values=part.values[order])


def no_store(_part: Part, _loading: Loading) -> Store:
    """Refuses to open values by pairs of a grid, of which a BTF of lists has none."""
    raise DataError("scattered samples have no store; read them list by list.")


def spread_directions(directions: Tensor, count: int = STANDING) -> Tensor:
    """At most `count` of `directions [N, 3]`, far from each other: the lowest one, then others.

    Each next one is the farthest from those chosen, which needs `count` passes.
    """
    lowest = int(directions[:, 2].argmin())
    step = max(1, len(directions) // CANDIDATES)
    some = torch.cat((directions[lowest][None], directions[::step]))
    chosen, distance = [0], (some - some[0]).norm(dim=1)
    while len(chosen) < min(count, len(some)) and float(distance.max()) > 2.0 * SAME_DIRECTION:
        chosen.append(int(distance.argmax()))
        distance = torch.minimum(distance, (some - some[chosen[-1]]).norm(dim=1))
    return some[chosen]
