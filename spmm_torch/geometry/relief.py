"""The relief: which point of a surface with heights a view shows at a place of its plane.

A view wo shows, at plane position p, the surface point over x where p = x - h(x) s, with
s = wo_xy / wo_z. Heights are in units of the texture's width above the plane in which pictures
were rectified; texels are square.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import torch
from torch import Tensor
from torch.nn.functional import embedding_bag

from .directions import texel_at, turn
from .ray_walk import Cells, Rays, first_heights, folded
from .shapes import broadcast_shape

# Least slope of the surface against a ray that a gradient is divided by: at an outline it is 0,
# and the place of the hit has no derivative.
LEAST_CROSSING = 1e-3


@dataclass(frozen=True)
class Footprint:
    """The bilinear lookups of all texel centres under some views.

    Attributes:
        texel, weight: four texels of each hit and their weights, `[V, T, 4]`.
        inside: whether the hit lies within the measured patch, `[V, T]` bool.
    """

    texel: Tensor
    weight: Tensor
    inside: Tensor

    def drawn(self, values: Tensor, view: int = 0) -> Tensor:
        """Values of texels `[T, d, C]` as one of the views shows them, `[T, d, C]`."""
        texel, weight = (part[view].to(values.device) for part in (self.texel, self.weight))
        mixed = embedding_bag(texel, values.flatten(1), mode="sum", per_sample_weights=weight)
        return mixed.view(values.shape)


@dataclass(frozen=True)
class HeightField:
    """Heights over the texels of a texture.

    Attributes:
        height: `[H, W]`, in units of the texture's width, above or below the plane.
        rule: how the texture continues beyond its border; see `directions.RULES`.
        slope: greatest |wo_xy| / wo_z that is walked; more grazing views shift as much.
    """

    height: Tensor
    rule: str
    slope: float

    @cached_property
    def cells(self) -> Cells:
        """The map as rays walk over it."""
        return Cells.build(self.height.detach(), self.rule, self.slope)

    def shift(self, wo: Tensor) -> Tensor:
        """s `[..., 2]` of views `[..., 3]`: texture widths rightwards and up for each of height."""
        flat = wo[..., :2]
        length = torch.linalg.vector_norm(flat, dim=-1)
        # Of the direction straight down, which shows nothing, and of views from above alone.
        tiny = torch.finfo(wo.dtype).tiny
        down = torch.maximum(wo[..., 2], length / max(self.slope, tiny))
        return flat / down.clamp(min=tiny)[..., None]

    def hit(self, uv: Tensor, wo: Tensor) -> Tensor:
        """Where the surface point lies that a view shows at a place of the plane.

        The first one that the ray p + t s meets on its way from the highest to the least height.

        Args:
            uv: places p `[..., 2]`, u right, v up, in any copy of the texture.
            wo: unit views `[..., 3]`.

        Returns:
            uv of the surface point `[..., 2]`, unbounded as `uv`; equal to it where all heights
            are 0. Differentiable in `height`, uv and wo.
        """
        uv, wo, shift = self._rays(uv, wo)
        if not self.height.requires_grad and self.cells.low == self.cells.high == 0.0:
            return uv
        with torch.no_grad():
            t = self.first(uv, shift)
        if torch.is_grad_enabled() and (
            self.height.requires_grad or uv.requires_grad or wo.requires_grad
        ):
            t = self._with_gradient(t, uv, shift)
        return uv + t[..., None] * shift

    def hit_of_all(self, uv: Tensor, wo: Tensor) -> Tensor:
        """`hit` with the walk as one opaque operator: it can be compiled and transformed.

        Args:
            uv: places `[..., 2]`.
            wo: unit views `[..., 3]`.
        """
        uv, wo, shift = self._rays(uv, wo)
        given = (part.detach() for part in (self.height, uv, shift))
        t = walk_rays(*given, self.rule, self.slope)
        return uv + self._with_gradient(t, uv, shift)[..., None] * shift

    def _rays(self, uv: Tensor, wo: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """uv, wo and the shift in units of u and v, of one shape and of the finer type."""
        shape = broadcast_shape(uv.shape[:-1], wo.shape[:-1])
        uv, wo = uv.expand(*shape, 2), wo.expand(*shape, 3)
        return uv, wo, self._shift_in_uv(wo).to(torch.promote_types(uv.dtype, wo.dtype))

    def place(self, uv: Tensor, wo: Tensor) -> Tensor:
        """Where of the plane views would show surface points, if nothing stood before them.

        Args:
            uv: surface points `[..., 2]`.
            wo: unit views `[..., 3]`.

        Returns:
            uv of the places `[..., 2]`.
        """
        return uv - self._at(uv)[..., None] * self._shift_in_uv(wo)

    def footprint(self, view: Tensor, drift: Tensor | None = None) -> Footprint:
        """What the pictures of some views show at each texel centre.

        Args:
            view: unit vectors `[V, 3]`.
            drift: registration of each picture, added to its places of the plane, `[V, 2]` in
                units of u and v; None: 0.
        """
        rows, columns = self.height.shape
        uv = texel_centres(rows, columns, view)  # [T, 2]
        uv = uv[None] if drift is None else uv + drift[:, None].to(uv)
        at = self.hit(uv, view[:, None])
        inside = ((at >= 0.0) & (at <= 1.0)).all(-1)
        return Footprint(*texel_at(at, rows, columns, self.rule), inside)

    def _shift_in_uv(self, wo: Tensor) -> Tensor:
        """`shift` in units of u and v."""
        rows, columns = self.height.shape
        shift = self.shift(wo)
        return shift * shift.new_tensor([1.0, columns / rows])

    def first(self, uv: Tensor, shift: Tensor) -> Tensor:
        """The height `[...]` of each hit, without gradient.

        Args:
            uv: places `[..., 2]`.
            shift: of rays, in units of u and v for each of height, `[..., 2]`.
        """
        rows, columns = self.height.shape
        at = uv.reshape(-1, 2).to(shift.dtype)
        speed = shift.reshape(-1, 2)
        rays = Rays(
            at[:, 0] * columns - 0.5,
            (1.0 - at[:, 1]) * rows - 0.5,
            speed[:, 0] * columns,
            -speed[:, 1] * rows,
        )
        height = first_heights(self.cells, folded(rays, rows, columns, self.rule))
        return height.view(uv.shape[:-1])

    def _with_gradient(self, t: Tensor, uv: Tensor, shift: Tensor) -> Tensor:
        """The heights t `[...]` of hits with the gradient of the implicit function t = h(p + t s).

        One Newton step, whose value is left out: the walk is exact already.
        """
        slope = self._slope(uv.detach() + t[..., None] * shift.detach(), shift.detach())
        height = self._at(uv + t[..., None] * shift)
        crossing = (1.0 - slope).clamp(min=LEAST_CROSSING)
        return t + (height - height.detach()) / crossing

    def _slope(self, uv: Tensor, shift: Tensor) -> Tensor:
        """By how much the surface rises along rays `[..., 2]` at uv `[..., 2]`, per unit of t."""
        rows, columns = self.height.shape
        index, weight = texel_at(uv, rows, columns, self.rule)
        a, b, c, d = self.height.detach().flatten()[index].unbind(-1)
        _, right, below, corner = weight.unbind(-1)
        right, below = right + corner, below + corner
        across = torch.lerp(b - a, d - c, below)
        down = torch.lerp(c - a, d - b, right)
        across = across * turn(uv[..., 0] * columns - 0.5, columns, self.rule)
        down = down * turn((1.0 - uv[..., 1]) * rows - 0.5, rows, self.rule)
        return across * (shift[..., 0] * columns) - down * (shift[..., 1] * rows)

    def _at(self, uv: Tensor) -> Tensor:
        """The height `[...]` at uv `[..., 2]`."""
        rows, columns = self.height.shape
        index, weight = texel_at(uv, rows, columns, self.rule)
        return (self.height.flatten()[index] * weight).sum(-1)


@torch.library.custom_op(
    "spmm_torch::walk_rays",
    mutates_args=(),
    schema="(Tensor height, Tensor uv, Tensor shift, str rule, float slope) -> Tensor",
)
def walk_rays(height: Tensor, uv: Tensor, shift: Tensor, rule: str, slope: float) -> Tensor:
    """`HeightField.first` as an operator of torch: how long a walk takes depends on its values.

    Args:
        height, rule, slope: of the field.
        uv, shift: of the rays, `[..., 2]`.
    """
    return HeightField(height, rule, slope).first(uv, shift)


@walk_rays.register_fake
def _(height: Tensor, uv: Tensor, shift: Tensor, rule: str, slope: float) -> Tensor:
    return shift.new_empty(uv.shape[:-1])


@walk_rays.register_vmap
def _(
    info: Any,
    in_dims: tuple[int | None, ...],
    height: Tensor,
    uv: Tensor,
    shift: Tensor,
    rule: str,
    slope: float,
) -> tuple[Tensor, int]:
    """Rays of a whole batch walk together over one map; several maps are walked one by one."""
    of_height, *of_rays = in_dims[:3]
    uv, shift = (
        part.expand(info.batch_size, *part.shape) if dim is None else part.movedim(dim, 0)
        for part, dim in zip((uv, shift), of_rays, strict=True)
    )
    if of_height is None:
        return walk_rays(height, uv, shift, rule, slope), 0
    maps = zip(height.movedim(of_height, 0), uv, shift, strict=True)
    return torch.stack([walk_rays(*each, rule, slope) for each in maps]), 0


def texel_centres(rows: int, columns: int, like: Tensor) -> Tensor:
    """uv `[T, 2]` of the centres of texels, row 0 at the top, of the type and device of `like`."""
    row, column = (
        torch.arange(n, dtype=like.dtype, device=like.device) + 0.5 for n in (rows, columns)
    )
    v, u = torch.meshgrid(1.0 - row / rows, column / columns, indexing="ij")
    return torch.stack((u, v), dim=-1).flatten(0, 1)


def steepest(view: Tensor, most: float) -> float:
    """The greatest |wo_xy| / wo_z of views `[V, 3]` over the horizon, at most `most`."""
    z = view[:, 2].clamp(min=0.0)
    slope = torch.linalg.vector_norm(view[:, :2], dim=-1) / z.clamp(min=1.0 / most)
    return float(slope.max().clamp(max=most))
