"""The input made larger for measurements of scaling: more texels, or more directions."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from ..data import BTF
from ..data.codes import Index
from ..data.store import Store
from ..geometry.directions import ring_directions
from ..geometry.hemisphere import HemisphereInterpolation

# Gains of the repeats: their range, most waves across the picture, and number of waves.
DARKEST, BRIGHTEST, WAVES, FIELDS = 0.6, 1.0, 5, 8


@dataclass(frozen=True)
class TiledStore:
    """Repeated texels of another store, each with its own gain.

    Attributes:
        base: the store that is repeated.
        texel: index of each texel in the base, `[T]`.
        gain: of each texel and channel, `[T, C]`.
    """

    base: Store
    texel: Tensor
    gain: Tensor
    is_hdr: bool = False

    @property
    def level(self) -> float:
        """A bound on the highest value; see `Store.level`."""
        return self.base.level * float(self.gain.max())

    def texels(self, index: Index, device: torch.device | str = "cpu") -> Tensor:
        """Values `[n, D, C]` float32."""
        chosen = slice(None) if index is None else index
        values = self.base.texels(self.texel[chosen], device)
        return values * self.gain[chosen].to(device)[:, None]

    def signals(self, index: Index, device: torch.device | str = "cpu") -> Tensor:
        """Values `[n, C, D]` float32."""
        chosen = slice(None) if index is None else index
        values = self.base.signals(self.texel[chosen], device)
        return values * self.gain[chosen].to(device)[..., None]

    def pairs(self, start: int, stop: int) -> Tensor:
        """Values `[T, stop - start, C]` float32."""
        return self.base.pairs(start, stop)[self.texel] * self.gain[:, None]

    def strips(
        self, texel: Tensor, view: Tensor, lights: int, device: torch.device | str = "cpu"
    ) -> Tensor:
        """Values `[N, L, C]` of texels `[N]`, each under all lights of its view `[N]`."""
        values = self.base.strips(self.texel[texel], view, lights, device)
        return values * self.gain[texel].to(device)[:, None]


def tiled(btf: BTF, base: Store, count: int) -> BTF:
    """A square of about `count` texels: those of `btf` repeated, no two alike.

    Smooth gains of each channel tell the repeats apart. Values are computed from the codes of
    `btf` when they are read, so memory stays that of `btf`.

    Args:
        btf: that is repeated.
        base: its values.
        count: number of texels.
    """
    side = round(math.sqrt(count))
    store = TiledStore(base, repeated(btf, side), gains(side, btf.channels))
    return replace(
        btf,
        name=f"{btf.name}, {side} x {side}",
        height=side,
        width=side,
        open_store=lambda part, loading: store,
        hdr=False,
        streamed=True,
    )


def repeated(btf: BTF, side: int) -> Tensor:
    """The texel of a BTF at each of `side * side` places, `[side * side]`."""
    row, column = torch.arange(side) % btf.height, torch.arange(side) % btf.width
    return (row[:, None] * btf.width + column).flatten()


def gains(side: int, channels: int) -> Tensor:
    """Smooth gains of texels, `[side * side, C]`, between DARKEST and BRIGHTEST."""
    generator = torch.Generator().manual_seed(0)
    across = torch.arange(side) / side
    field = torch.zeros(side, side, channels)
    for _ in range(FIELDS):
        wave = torch.randint(-WAVES, WAVES + 1, (2, channels), generator=generator)
        phase = 2.0 * math.pi * torch.rand(channels, generator=generator)
        turn = across[:, None, None] * wave[0] + across[:, None] * wave[1]
        field += torch.cos(2.0 * math.pi * turn + phase)
    low, high = field.amin((0, 1)), field.amax((0, 1))
    field = (field - low) / (high - low).clamp(min=torch.finfo(torch.float32).tiny)
    return (DARKEST + (BRIGHTEST - DARKEST) * field).flatten(0, 1)


def with_directions(btf: BTF, rings: tuple[tuple[float, int], ...]) -> BTF:
    """The same texels under other directions, interpolated between measured ones."""
    directions = ring_directions(rings)
    view = _interpolation(btf.view, directions)  # [V', V]
    light = _interpolation(btf.light, directions)  # [L', L]
    values = btf.texels().unflatten(1, (len(btf.view), len(btf.light)))  # [T, V, L, C]
    values = torch.einsum("wv,tvlc->twlc", view, values)
    values = torch.einsum("ml,twlc->wmtc", light, values)
    pictures = values.unflatten(2, (btf.height, btf.width)).half()
    return BTF.from_values(pictures, directions, directions, name=btf.name)


def _interpolation(measured: Tensor, wanted: Tensor) -> Tensor:
    """Weights `[W, M]` of measured directions `[M, 3]` at wanted ones `[W, 3]`."""
    index, weight = HemisphereInterpolation.build(measured).weights(wanted)
    return torch.zeros(len(wanted), len(measured)).scatter_add_(1, index, weight)
