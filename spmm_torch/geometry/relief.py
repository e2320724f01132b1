"""The relief: which point of a surface with heights a view shows at a place of its plane.

A view wo shows, at plane position p, the surface point over x where p = x - h(x) s, with
s = wo_xy / wo_z. Heights are in units of the texture's width above the plane in which pictures
were rectified; texels are square.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import torch
from torch import Tensor
from torch.nn.functional import embedding_bag

from .directions import texel_at
from .ray_walk import Cells, Rays, first_heights, folded

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
        shape = torch.broadcast_shapes(uv.shape[:-1], wo.shape[:-1])
        uv, wo = uv.expand(*shape, 2), wo.expand(*shape, 3)
        if not self.height.requires_grad and self.cells.low == self.cells.high == 0.0:
            return uv
        shift = self._shift_in_uv(wo).to(torch.promote_types(uv.dtype, wo.dtype))
        with torch.no_grad():
            t = self._first(uv, shift)
        if torch.is_grad_enabled() and (
            self.height.requires_grad or uv.requires_grad or wo.requires_grad
        ):
            t = self._with_gradient(t, uv, shift)
        return uv + t[..., None] * shift

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

    def _first(self, uv: Tensor, shift: Tensor) -> Tensor:
        """The height `[...]` of each hit."""
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
        at = t.detach().requires_grad_()
        along = self._at(uv.detach() + at[..., None] * shift.detach())
        (slope,) = torch.autograd.grad(along.sum(), at)
        height = self._at(uv + t[..., None] * shift)
        crossing = (1.0 - slope).clamp(min=LEAST_CROSSING)
        return t + (height - height.detach()) / crossing

    def _at(self, uv: Tensor) -> Tensor:
        """The height `[...]` at uv `[..., 2]`."""
        rows, columns = self.height.shape
        index, weight = texel_at(uv, rows, columns, self.rule)
        return (self.height.flatten()[index] * weight).sum(-1)


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
