"""Lists of pairs of directions, and the texels that were measured under each."""

from __future__ import annotations

from dataclasses import dataclass, replace

import torch
from torch import Tensor

from .btf import BTF
from .codes import Index
from .store import channels_first


@dataclass(frozen=True)
class PairList:
    """n texels that were measured under the same D pairs.

    Attributes:
        texels: their indices, ascending, `[n]`.
        wi, wo: directions of the pairs, `[D, 3]` float32.
        values: `[n, D, C]` float32.
    """

    texels: Tensor
    wi: Tensor
    wo: Tensor
    values: Tensor

    def scaled(self, factor: float) -> PairList:
        """The same with values times a factor."""
        return replace(self, values=self.values * factor)

    def at(self, pairs: Tensor) -> PairList:
        """The same texels at some of the pairs `[d]`."""
        return replace(self, wi=self.wi[pairs], wo=self.wo[pairs], values=self.values[:, pairs])


@dataclass(frozen=True)
class ListStore:
    """The values `[n, D, C]` of a list, as the store of a BTF."""

    values: Tensor

    @property
    def is_hdr(self) -> bool:
        """Whether a value exceeds 1."""
        return self.level > 1.0

    @property
    def level(self) -> float:
        """The highest value."""
        return float(self.values.max())

    def texels(self, index: Index, device: torch.device | str = "cpu") -> Tensor:
        """Values `[m, D, C]`; see `Store.texels`."""
        return (self.values if index is None else self.values[index]).to(device)

    def signals(self, index: Index, device: torch.device | str = "cpu") -> Tensor:
        """Values `[m, C, D]`; see `Store.signals`."""
        return channels_first(self.texels(index, device))

    def pairs(self, start: int, stop: int) -> Tensor:
        """Values `[n, stop - start, C]`; see `Store.pairs`."""
        return self.values[:, start:stop]

    def strips(
        self, texel: Tensor, view: Tensor, lights: int, device: torch.device | str = "cpu"
    ) -> Tensor:
        """Values `[N, L, C]`; see `Store.strips`."""
        return self.values.unflatten(1, (-1, lights))[texel, view].to(device)


class PairedBTF(BTF):
    """The texels of one list: D pairs, each of a light `light [D, 3]` and a view `view [D, 3]`."""

    @classmethod
    def of(cls, pairs: PairList, name: str = "") -> PairedBTF:
        """The BTF of a list, whose texels are no neighbours."""
        store, count = ListStore(pairs.values), len(pairs.texels)
        names = tuple(map(str, pairs.texels.tolist()))
        found = cls(name, "", 1, count, pairs.wo, pairs.wi, 4, lambda part, loading: store)
        return replace(found, hdr=None, names=names, channels=pairs.values.shape[2])

    @property
    def pair_shape(self) -> tuple[int, int]:
        """(1, D): the pairs are those of no grid."""
        return 1, len(self.light)

    def pairs(self) -> tuple[Tensor, Tensor]:
        """Directions `(wi [D, 3], wo [D, 3])` of the pairs."""
        return self.light, self.view
