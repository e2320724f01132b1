"""Lobes on direction pairs together with their derivatives along the search coordinates.

BRDFs tell the logarithmic derivatives of f_r, and what follows from a turn of the frame is the same
for all: a small rotation omega moves a local direction w by omega x w. Of a grid of pairs only
products are as large as the grid: what belongs to one direction alone is known by its direction.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import torch
from torch import Tensor

from ..brdf import MAX_PARAMETERS, REGISTRY
from ..brdf.base import COS_EPS, Vectors
from ..brdf.slopes import Angles, LocalPairs, Slopes
from ..geometry.directions import frame_from_normal, normal_from_disk
from ..geometry.shapes import broadcast_shape
from ..runtime.memory import slices
from .batch import COORDINATES, Scales
from .cut import view_step_with_slope
from .ragged import Grouped, Spans, in_spans, spans_within
from .recorded import record

# Values of one tensor of a block. On a CPU few enough for the caches, and enough to hide the cost
# of a call. On a GPU lobes of all models share a block, which takes 4 GB.
CPU_BLOCK_VALUES, CUDA_BLOCK_VALUES = 1 << 16, 1 << 24
# Coordinates that turn the frame: disk x, disk y and the angle, of anisotropic models alone.
TURNS = 3


@dataclass(frozen=True)
class Directions:
    """Pairs of directions, and what is the same of them for all lobes.

    Attributes:
        wi, wo: `[1, ..., 3]`, broadcast as in `LobeBatch.eval`.
    """

    wi: Tensor
    wo: Tensor

    @property
    def shape(self) -> torch.Size:
        """That of values of a lobe at all pairs."""
        return broadcast_shape(self.wi.shape[1:-1], self.wo.shape[1:-1])

    @cached_property
    def angles(self) -> Angles:
        """The angles between them."""
        return Angles.between(self.wi, self.wo)

    @cached_property
    def lit(self) -> tuple[Tensor, Tensor]:
        """1 where wi and where wo is above the horizon of the texel, else 0, `[1, ...]` each."""
        above = [(w[..., 2] > 0.0).to(w.dtype) for w in (self.wi, self.wo)]
        return above[0], above[1]

    @cached_property
    def components(self) -> tuple[Tensor, Tensor, Tensor]:
        """x, y and z of all wi, then of all wo, `[1, 1, 1, N]` each."""
        both = torch.cat((self.wi.flatten(0, -2), self.wo.flatten(0, -2)))
        x, y, z = both.T.contiguous()[:, None, None, None].unbind()
        return x, y, z

    def split(self, values: Tensor) -> tuple[Tensor, Tensor]:
        """Values `[..., N]` of all directions as those of wi and of wo, `[..., *middle]` each."""
        shapes = self.wi.shape[1:-1], self.wo.shape[1:-1]
        of_wi, of_wo = values.split([shape.numel() for shape in shapes], dim=-1)
        return of_wi.unflatten(-1, shapes[0]), of_wo.unflatten(-1, shapes[1])


def linearize(
    model: Tensor,
    coordinates: Tensor,
    directions: Directions,
    horizon: float = 0.0,
    scale: Tensor | None = None,
    grouped: Grouped | None = None,
) -> Tensor:
    """Values of lobes and their Jacobian [WDR11 Eq. 3], one after the other.

    Args:
        model: `[J]`.
        coordinates: search coordinates `[J, COORDINATES]`.
        directions: at which lobes are seen.
        horizon: of the lobes, as in `LobeBatch`.
        scale: factor of all values of a pair, `[...]`; None: 1.
        grouped: of `model`, where it is known; the host waits to know it.

    Returns:
        `[J, 1 + COORDINATES, ...]`: rho, then d rho / d coordinates, which is 0 along coordinates
        that a model does not have.
    """
    order, spans = grouped or in_spans(model, len(REGISTRY))
    lobes = _Lobes.build(spans, coordinates.detach().index_select(0, order), directions, horizon)
    shape = directions.shape
    found = coordinates.new_empty(len(model), 1 + COORDINATES, *shape)
    for part, own in _blocks(spans, len(model), shape.numel(), coordinates.is_cuda):
        block = coordinates.new_empty(part.stop - part.start, 1 + COORDINATES, *shape)
        _fill(block, own, lobes[part], directions.angles, scale)
        found.index_copy_(0, order[part], block)
    return found


def _blocks(spans: Spans, count: int, pairs: int, together: bool) -> Iterator[tuple[slice, Spans]]:
    """Lobes in blocks of so many pairs: which, and where each model lies among them."""
    if together:
        for part in slices(count, max(1, CUDA_BLOCK_VALUES // max(1, pairs))):
            yield part, spans_within(spans, part)
        return
    for model, own in spans:
        for part in slices(own.stop - own.start, max(1, CPU_BLOCK_VALUES // max(1, pairs))):
            yield (
                slice(own.start + part.start, own.start + part.stop),
                [(model, slice(0, part.stop - part.start))],
            )


@dataclass(frozen=True)
class _Lobes:
    """Lobes in the order of their models, with directions in the frame of each.

    Attributes:
        kappa: parameters, `[J, P, 1, ...]`.
        growth: their derivatives along the search coordinates, `[J, P, 1, ...]`.
        wi, wo: local directions, then their derivatives along the coordinates that turn the frame,
            `[J, 1 + TURNS, 3, ...]`, which broadcast.
        end_i, end_o: factors of f_r that belong to one direction: its cosine, its horizon.
        slope_i, slope_o: their logarithmic derivatives along the cosine.
        cosine_i, cosine_o, fall_i, fall_o: as in `LocalPairs`.
    """

    kappa: Tensor
    growth: Tensor
    wi: Tensor
    wo: Tensor
    end_i: Tensor
    end_o: Tensor
    slope_i: Tensor
    slope_o: Tensor
    cosine_i: Tensor
    cosine_o: Tensor
    fall_i: Tensor
    fall_o: Tensor

    @classmethod
    def build(
        cls, spans: Spans, coordinates: Tensor, directions: Directions, horizon: float
    ) -> _Lobes:
        """Lobes at search `coordinates [J, COORDINATES]` that see the directions."""
        table = Scales.of(spans, coordinates)
        kappa, normal = table.values(coordinates[:, TURNS:]), normal_from_disk(coordinates[:, :2])
        frame = frame_from_normal(normal, coordinates[:, 2] * table.turn)
        spins = _spins(table.turn, coordinates, frame)  # [J, TURNS, 3]
        turned = torch.linalg.cross(spins[..., None], frame[:, None], dim=2)  # [J, TURNS, 3, 3]
        frames = torch.cat((frame[:, None], turned), dim=1)
        local = _seen(frames, directions)
        local_i, local_o = directions.split(local)
        cosine = local[:, 0, 2].clamp(min=COS_EPS)
        z_i, z_o = local_i[:, 0, 2], local_o[:, 0, 2]
        (lit_i, lit_o), middle = directions.lit, (1,) * len(directions.shape)
        height, (step, slope) = z_i.clamp(min=0.0), view_step_with_slope(z_o, horizon)
        return cls(
            kappa.view(*kappa.shape, *middle),
            table.slopes(kappa).view(*kappa.shape, *middle),
            local_i,
            local_o,
            height * lit_i,
            step * lit_o,
            height.sign() / z_i.clamp(min=torch.finfo(z_i.dtype).tiny),
            slope,
            *directions.split(cosine),
            *directions.split((cosine > COS_EPS) / -cosine),
        )

    def __getitem__(self, rows: slice) -> _Lobes:
        return _Lobes(*(part[rows] for part in vars(self).values()))

    def pairs(self, angles: Angles) -> LocalPairs:
        """All pairs of directions in the frames of the lobes."""
        cosines, falls = (self.cosine_i, self.cosine_o), (self.fall_i, self.fall_o)
        return LocalPairs(self.wi[:, 0], self.wo[:, 0], cosines, falls, angles)

    def moved(self, column: int) -> tuple[Sequence[Tensor], Sequence[Tensor]]:
        """Derivatives of the components of wi and of wo along a coordinate, three `[J, ...]` each.

        A turn about the normal leaves z as it is.
        """
        return self.wi[:, 1 + column].unbind(1), self.wo[:, 1 + column].unbind(1)


def _fill(block: Tensor, spans: Spans, lobes: _Lobes, angles: Angles, scale: Tensor | None) -> None:
    """Writes values and Jacobian of lobes to `block [J, 1 + COORDINATES, ...]`."""
    pairs = lobes.pairs(angles)
    alone = len(spans) == 1
    slopes = [
        REGISTRY[model].slopes(
            lobes.kappa[rows, : len(REGISTRY[model].parameters)], pairs if alone else pairs[rows]
        )
        for model, rows in spans
    ]
    known = [part for part in slopes if part is not None]
    if not alone and len(known) == len(slopes):
        _assemble(block, _joined(known, spans, block.shape[2:]), lobes, scale)
        return
    for (model, rows), part in zip(spans, slopes, strict=True):
        if part is None:
            _assemble_recorded(block[rows], model, lobes[rows], scale)
        else:
            _assemble(block[rows], part, lobes[rows], scale)


def _assemble(block: Tensor, slopes: Slopes, lobes: _Lobes, scale: Tensor | None) -> None:
    """Writes rho and its derivatives, given those of the logarithm of f_r, to `block`."""
    rho = block[:, 0]
    tangents = slopes.half[0] is not None or slopes.half[1] is not None
    torch.mul(slopes.value, lobes.end_i, out=rho)  # Eq. (3)
    rho.mul_(lobes.end_o if scale is None else lobes.end_o * scale)
    slope_i = _sum(slopes.cos_theta_i, lobes.slope_i)
    slope_o = _sum(slopes.cos_theta_o, lobes.slope_o)
    turns = slice(1, 1 + TURNS if tangents else TURNS)
    wi, wo = lobes.wi[:, turns], lobes.wo[:, turns]  # [J, turns, 3, ...]
    total = slope_i[:, None] * wi[:, :, 2] + slope_o[:, None] * wo[:, :, 2]
    for axis, half in enumerate(slopes.half):
        if half is not None:
            total.add_((wi[:, :, axis] + wo[:, :, axis]).mul_(half[:, None]))
    torch.mul(total, rho[:, None], out=block[:, turns])
    if not tangents:
        block[:, TURNS].zero_()
    for column in range(MAX_PARAMETERS):
        place = block[:, 1 + TURNS + column]
        if column < len(slopes.kappa):
            torch.mul(slopes.kappa[column], rho, out=place)
            place.mul_(lobes.growth[:, column])
        else:
            place.zero_()


def _sum(a: Tensor | None, b: Tensor) -> Tensor:
    return b if a is None else a + b


def _assemble_recorded(block: Tensor, model: int, lobes: _Lobes, scale: Tensor | None) -> None:
    """The same for a model that does not tell its slopes."""
    parameters = lobes.kappa[:, : len(REGISTRY[model].parameters)].unbind(1)
    pairs = (Vectors(tuple(w[:, 0].unbind(1))) for w in (lobes.wi, lobes.wo))
    found = record(model, parameters, *pairs)
    ends = lobes.end_i * (lobes.end_o if scale is None else lobes.end_o * scale)
    rho = block[:, 0]
    torch.mul(found.value, ends, out=rho)  # Eq. (3)
    for column in range(TURNS):
        wi, wo = lobes.moved(column)
        along: Any = sum(g * w for g, w in zip((*found.wi, *found.wo), (*wi, *wo), strict=True))
        block[:, 1 + column] = ends * along + rho * (lobes.slope_i * wi[2] + lobes.slope_o * wo[2])
    block[:, 1 + TURNS :] = 0.0
    for column, along in enumerate(found.kappa):
        block[:, 1 + TURNS + column] = ends * along * lobes.growth[:, column]


def _joined(parts: list[Slopes], spans: Spans, shape: torch.Size) -> Slopes:
    """The slopes of several models as those of all their lobes."""
    zero = torch.zeros_like(parts[0].value[:1])
    sizes = [rows.stop - rows.start for _, rows in spans]

    def column(own: list[Tensor | None]) -> Tensor | None:
        if all(part is None for part in own):
            return None
        full = [zero if part is None else part for part in own]
        return torch.cat([x.expand(n, *shape) for x, n in zip(full, sizes, strict=True)])

    def all_of(own: list[Tensor | None]) -> Tensor:
        found = column(own)
        return zero.expand(sum(sizes), *shape) if found is None else found

    most = max(len(part.kappa) for part in parts)
    kappa = [
        all_of([part.kappa[k] if k < len(part.kappa) else None for part in parts])
        for k in range(most)
    ]
    half = [column([part.half[axis] for part in parts]) for axis in range(3)]
    return Slopes(
        all_of([part.value for part in parts]),
        tuple(kappa),
        column([part.cos_theta_i for part in parts]),
        column([part.cos_theta_o for part in parts]),
        (half[0], half[1], half[2]),
    )


def _seen(frames: Tensor, directions: Directions) -> Tensor:
    """Local directions `[J, F, 3, N]` of all wi and wo, for `frames [J, F, 3, 3]`.

    Written out, because matrix libraries are slow for products of 3 x 3 matrices.
    """
    x, y, z = directions.components
    a, b, c = frames[..., None].unbind(3)  # [J, F, 3, 1]
    return a * x + b * y + c * z


def _spins(turn: Tensor, coordinates: Tensor, frame: Tensor) -> Tensor:
    """Rotations omega `[J, TURNS, 3]` of the frames, in local axes, along disk x, y and angle.

    `turn [J]` is 1 for lobes that have a tangent.

    As n moves by dn, the shortest rotation from z to n turns about n by
    (n_x dn_y - n_y dn_x) / (1 + n_z).
    """
    disk, normal = coordinates[:, :2], frame[:, 2]
    squares = disk * disk
    stretch = torch.sqrt(2.0 - squares[:, :1] - squares[:, 1:])  # [J, 1]
    mixed = -disk[:, :1] * disk[:, 1:] / stretch
    along, down = stretch - squares / stretch, -2.0 * disk  # [J, 2]
    parts = along[:, :1], mixed, down[:, :1], mixed, along[:, 1:], down[:, 1:]
    step = torch.cat(parts, dim=1).view(-1, 2, 3)  # d normal / d disk
    local = step @ frame.transpose(1, 2)
    planar = normal[:, None, :2] * step[..., :2].flip(-1)
    spin = (planar[..., 0] - planar[..., 1]) / (1.0 + normal[:, 2:])  # [J, 2]
    spins = torch.stack((local[..., 1], -local[..., 0], spin), dim=2)
    about_normal = torch.nn.functional.pad(-turn[:, None, None], (2, 0))
    return torch.cat((spins, about_normal), dim=1)
