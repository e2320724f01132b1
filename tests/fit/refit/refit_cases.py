"""Small cases of the refit, and the same maths with dense matrices."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import torch
from torch import Tensor

from spmm_torch import BTF
from spmm_torch.fit.refit.lookups import Lookups
from spmm_torch.geometry.directions import MIRROR, REPEAT, ring_directions
from spmm_torch.geometry.relief import HeightField, texel_centres
from spmm_torch.model.lookup import SparseWeights

VIEW = ring_directions(((0.0, 1), (40.0, 3), (65.0, 4)))
LIGHT = ring_directions(((20.0, 2), (55.0, 3)))
LOBES = 5
CPU = torch.device("cpu")


def silent(count: int) -> None:
    """No progress."""


@dataclass(frozen=True)
class Case:
    """What each pixel shows, and lobes of all texels.

    Attributes:
        field: heights of the surface.
        drift: registration of each picture, `[V, 2]`; None: 0.
        importance: weights of the pixels, `[T]`; None: 1.
        scale: square roots of the weights of pairs, `[D]`; None: 1.
        entries: lobes of all texels.
        rho: values of the lobes without weights, `[V, J, L]`.
        pictures: of any values.
    """

    field: HeightField
    drift: Tensor | None
    importance: Tensor | None
    scale: Tensor | None
    entries: SparseWeights
    rho: Tensor
    pictures: BTF

    @property
    def lookups(self) -> Lookups:
        return Lookups.build(self.field, VIEW, self.drift, self.importance, CPU)

    @property
    def scaled_rho(self) -> Tensor:
        if self.scale is None:
            return self.rho
        return self.rho * self.scale.view(len(VIEW), 1, len(LIGHT))

    @property
    def texel(self) -> Tensor:
        """Texel of each entry `[N]`."""
        return torch.repeat_interleave(self.entries.offset.diff())

    def shown(self) -> Tensor:
        """W_v `[V, T, T]` float64 with the square roots of the weights of pixels."""
        dense = torch.from_numpy(drawn_matrices(self.field, self.drift))
        if self.importance is None:
            return dense
        return dense * self.importance.double().sqrt()[:, None]

    def pair_scale(self) -> Tensor:
        """Square roots of the weights of pairs, `[V, L]` float64."""
        shape = (len(VIEW), len(LIGHT))
        return torch.ones(shape).double() if self.scale is None else self.scale.double().view(shape)

    def lobe_design(self) -> Tensor:
        """Values `[V, T, L, N]` that each entry shows by a weight of 1."""
        own = self.rho.double()[:, self.entries.index]  # [V, N, L]
        shown = torch.einsum("vpn,vnl->vpln", self.shown()[:, :, self.texel], own)
        return shown * self.pair_scale()[:, None, :, None]

    def component_design(self, functions: Tensor) -> Tensor:
        """Values `[V, T, L, C, T, R]` that each coefficient of functions `[V, R, L, C]` shows."""
        shown = torch.einsum("vpt,vrlc->vplctr", self.shown(), functions.double())
        return shown * self.pair_scale()[:, None, :, None, None, None]

    def values(self) -> Tensor:
        """Pictures `[V, T, L, C]` float64 by the square roots of all weights."""
        pixel = 1.0 if self.importance is None else self.importance.double().sqrt()
        values = self.pictures.texels().unflatten(1, (len(VIEW), len(LIGHT))).transpose(0, 1)
        scaled = values.double() * self.pair_scale()[:, None, :, None]
        return scaled * torch.as_tensor(pixel).reshape(-1, 1, 1)


def case(
    height: int = 4,
    width: int = 5,
    *,
    depth: float = 0.2,
    rule: str = REPEAT,
    drift: bool = False,
    importance: bool = False,
    scale: bool = False,
) -> Case:
    """A relief of random heights, and random lobes of up to three for a texel."""
    generator = torch.Generator().manual_seed(7)
    texels, views, lights = height * width, len(VIEW), len(LIGHT)
    heights = depth * torch.rand(height, width, generator=generator)
    shift = 0.6 * torch.rand(views, 2, generator=generator) - 0.3
    count = torch.randint(0, 4, (texels,), generator=generator)
    count[0] = 2
    index = [torch.randperm(LOBES, generator=generator)[:n].sort().values for n in count.tolist()]
    weight = torch.rand(int(count.sum()), 3, generator=generator)
    entries = SparseWeights(
        torch.cat((torch.zeros(1).long(), count.cumsum(0))), torch.cat(index), weight
    )
    rho = torch.rand(views, LOBES, lights, generator=generator)
    values = torch.rand(views, lights, height, width, 3, generator=generator)
    return Case(
        HeightField(heights, rule, slope=2.5),
        shift if drift else None,
        0.2 + torch.rand(texels, generator=generator) if importance else None,
        (0.2 + torch.rand(views * lights, generator=generator)).sqrt() if scale else None,
        entries,
        rho,
        BTF.from_values(values, VIEW, LIGHT),
    )


def flat(like: Case) -> Case:
    """The same without heights and drift."""
    field = replace(like.field, height=torch.zeros_like(like.field.height))
    return replace(like, field=field, drift=None)


CASES = {
    "flat": flat(case()),
    "flat, weighted": flat(case(importance=True, scale=True)),
    "relief": case(),
    "mirrored": case(rule=MIRROR, drift=True),
    "weighted": case(rule=MIRROR, drift=True, importance=True, scale=True),
}


def drawn_matrices(field: HeightField, drift: Tensor | None) -> np.ndarray:
    """W_v `[V, T, T]`: each pixel's bilinear lookup, one by one."""
    rows, columns = field.height.shape
    found = np.zeros((len(VIEW), rows * columns, rows * columns))
    centres = texel_centres(rows, columns, VIEW)
    for view, direction in enumerate(VIEW):
        uv = centres if drift is None else centres + drift[view]
        for pixel, (u, v) in enumerate(field.hit(uv, direction).tolist()):
            column, row = u * columns - 0.5, (1.0 - v) * rows - 0.5
            left, top = int(np.floor(column)), int(np.floor(row))
            for r in (top, top + 1):
                for c in (left, left + 1):
                    share = (1.0 - abs(row - r)) * (1.0 - abs(column - c))
                    where = place(r, rows, field.rule) * columns + place(c, columns, field.rule)
                    found[view, pixel, where] += share
    return found


def place(index: int, count: int, rule: str) -> int:
    """Where the row or column `index` of a texture that goes on forever is found."""
    copy, within = divmod(index, count)
    return count - 1 - within if rule == MIRROR and copy % 2 else within
