"""What each pixel of each view shows: the sparse matrices W_v, their transposes and squares.

Pixel p of view v shows sum_q W_v[p, q] f_q(v, .), with four entries a row: the bilinear lookup at
the surface point that the pixel sees.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import torch
from torch import Tensor

from ...geometry.relief import HeightField
from ...runtime.memory import slices
from ...runtime.sparse import csr_matrix, sparse_product
from .matrices import matrix_of

# Pairs of corners of a 2 x 2 block, a before b: corners are in the order of rows.
CORNER_PAIRS = tuple((a, b) for a in range(4) for b in range(a, 4))
# Neighbours of a texel that its pixels may share, half of the 3 x 3 around it: (rows, columns).
HALF = ((0, 0), (0, 1), (1, -1), (1, 0), (1, 1))
# Pixels of the views that a GPU takes at once: 2 GB of values under 81 lights. A CPU takes one
# view, whose values then stay in its caches.
CUDA_PIXELS = 1 << 21


@dataclass(frozen=True)
class Lookups:
    """The lookups of all V views.

    Attributes:
        texel: four texels of each pixel, `[V, T, 4]` int32.
        weight: of each of them, `[V, T, 4]`, times the square root of the weight of the pixel.
        height, width: texels of the texture.
        mixed: whether a pixel may show several texels.
        pixel: square roots of the weights of the pixels, `[T]`; None: all 1.
    """

    texel: Tensor
    weight: Tensor
    height: int
    width: int
    mixed: bool
    pixel: Tensor | None = None
    _kept: dict[tuple[str, int, int, bool], Tensor] = field(
        default_factory=dict, repr=False, compare=False
    )

    @classmethod
    def build(
        cls,
        surface: HeightField,
        view: Tensor,
        drift: Tensor | None,
        importance: Tensor | None,
        device: torch.device,
    ) -> Lookups:
        """The lookups through a relief.

        Args:
            surface: its heights.
            view: `[V, 3]`.
            drift: registration of each picture, `[V, 2]`; None: 0.
            importance: weights of the pixels, `[T]`; None: 1.
            device: where the lookups lie.
        """
        height, width = surface.height.shape
        mixed = drift is not None or bool((surface.height != 0.0).any())
        texel, weight = _seen(surface, view, drift) if mixed else _alone(height * width, len(view))
        texel, weight = texel.to(device), weight.to(device)
        if importance is None:
            return cls(texel, weight, height, width, mixed)
        pixel = importance.float().sqrt().to(device)
        return cls(texel, weight * pixel[:, None], height, width, mixed, pixel)

    def squared(self, run: slice, values: Tensor) -> Tensor:
        """W_v^T W_v times values `[n T, R]` of n consecutive views, summed over them, `[T, R]`."""
        if not self.mixed:
            own = values * self._own_squares(run)
            return own if len(own) == self.texel.shape[1] else self._by_view(own).sum(0)
        return sparse_product(
            self.gathered(run), sparse_product(self.drawn(run, apart=True), values)
        )

    def squared_apart(self, run: slice, values: Tensor) -> Tensor:
        """W_v^T W_v times the same values `[T, R]` in each of n consecutive views, `[n, T, R]`."""
        if not self.mixed:
            return values * self._by_view(self._own_squares(run))
        return self._by_view(
            sparse_product(self.gathered(run, apart=True), sparse_product(self.drawn(run), values))
        )

    def _own_squares(self, run: slice) -> Tensor:
        """Squared weights of the pixels of views that each show their own texel, `[n T, 1]`."""
        return self.weight[run].square().sum(2).view(-1, 1)

    def _by_view(self, rows: Tensor) -> Tensor:
        """Rows `[n T, R]` of n views as `[n, T, R]`."""
        return rows.view(-1, self.texel.shape[1], rows.shape[1])

    @property
    def views(self) -> int:
        """V."""
        return len(self.texel)

    def runs(self, first: int = 0, last: int | None = None) -> list[slice]:
        """Consecutive views from `first` up to `last`, as many at once as the device takes."""
        last = self.views if last is None else last
        size = max(CUDA_PIXELS // self.texel.shape[1], 1) if self.texel.is_cuda else 1
        return [slice(first + run.start, first + run.stop) for run in slices(last - first, size)]

    def drawn(self, run: slice, apart: bool = False) -> Tensor:
        """W_v of n consecutive views, one under the other, sparse CSR: from texels to pixels.

        It is kept, as every step needs it.

        Args:
            run: the views.
            apart: whether each view has texels of its own, `[n T, n T]`; else all have the same,
                `[n T, T]`.
        """
        return self._once("drawn", self._untransposed, run, apart)

    def gathered(self, run: slice, apart: bool = False) -> Tensor:
        """W_v^T of n consecutive views, side by side, sparse CSR: from pixels to texels.

        It is kept, as every step needs it.

        Args:
            run: the views.
            apart: whether each view has texels of its own, `[n T, n T]`; else all have the same,
                `[T, n T]`.
        """
        return self._once("gathered", self._transposed, run, apart)

    def _once(
        self, name: str, made: Callable[[slice, bool], Tensor], run: slice, apart: bool
    ) -> Tensor:
        """A matrix of n views that is made once; all views of a flat surface show the same."""
        views = run.stop - run.start
        key = (name, run.start if self.mixed else 0, views, apart and views > 1)
        if key not in self._kept:
            self._kept[key] = made(run, apart)
        return self._kept[key]

    def _untransposed(self, run: slice, apart: bool) -> Tensor:
        """`drawn`, made anew."""
        views, texels = run.stop - run.start, self.texel.shape[1]
        pixels = views * texels
        rows = self._fours(pixels)
        column, weight = self._texels(run, apart).flatten(), self.weight[run].flatten()
        return csr_matrix(rows, column, weight, (pixels, pixels if apart else texels))

    def _fours(self, pixels: int) -> Tensor:
        """Places of the first of four entries a row, `[n T + 1]` int32, the same for all views."""
        key = ("fours", 0, pixels, False)
        if key not in self._kept:
            device = self.texel.device
            self._kept[key] = torch.arange(0, 4 * pixels + 1, 4, dtype=torch.int32, device=device)
        return self._kept[key]

    def _transposed(self, run: slice, apart: bool) -> Tensor:
        """`gathered`, made anew."""
        views, texels = run.stop - run.start, self.texel.shape[1]
        pixels = views * texels
        pixel = torch.arange(pixels, device=self.texel.device).repeat_interleave(
            4, output_size=4 * pixels
        )
        texel, weight = self._texels(run, apart).flatten(), self.weight[run].flatten()
        return matrix_of(texel, pixel, weight, (pixels if apart else texels, pixels))

    def _texels(self, run: slice, apart: bool) -> Tensor:
        """Texels `[n, T, 4]` of n views, counted on from view to view if they are to be `apart`."""
        texel, views = self.texel[run], run.stop - run.start
        if not apart or views == 1:
            return texel
        own = torch.arange(views, dtype=texel.dtype, device=texel.device) * texel.shape[1]
        return texel + own[:, None, None]

    def squares(self, views: slice) -> Tensor:
        """W_v^T W_v of n consecutive views, `[n, T, 5]`: of each texel and those in `HALF`."""
        count, texels = views.stop - views.start, self.texel.shape[1]
        table = torch.zeros(count, texels * len(HALF), device=self.texel.device)
        for run in self.runs(views.start, views.stop):
            here = slice(run.start - views.start, run.stop - views.start)
            self._add_squares(table[here].flatten(), run)
        return table.view(count, texels, len(HALF))

    def _add_squares(self, table: Tensor, run: slice) -> None:
        """Adds those of n views to `table [n T 5]`."""
        texel, weight = self.texel[run].flatten(0, 1), self.weight[run].flatten(0, 1)  # [n T, 4]
        own = self._texels(run, apart=True).flatten(0, 1)
        row, column = texel // self.width, texel % self.width
        for a, b in CORNER_PAIRS:
            # Equal at the border of a mirrored texture, and in one of a single row or column.
            down = (row[:, a] != row[:, b]).long()  # [T]
            right = (column[:, a] != column[:, b]) * (b % 2 - a % 2)
            back = (down == 0) & (right < 0)  # (0, -1) is (0, 1) of the other corner
            first = torch.where(back, own[:, b], own[:, a]).long()
            right = torch.where(back, 1, right)
            slot = torch.where(down > 0, 3 + right, right)
            product = weight[:, a] * weight[:, b]
            if a != b:  # both orders fall on one texel
                product = torch.where((down == 0) & (right == 0), 2.0 * product, product)
            table.scatter_add_(0, first * len(HALF) + slot, product)


def _seen(surface: HeightField, view: Tensor, drift: Tensor | None) -> tuple[Tensor, Tensor]:
    """Texels `[V, T, 4]` int32 and weights `[V, T, 4]` of views `[V, 3]` that drift `[V, 2]`."""
    shape = (len(view), surface.height.numel(), 4)
    texels, weights = torch.empty(shape, dtype=torch.int32), torch.empty(shape)
    for v in range(len(view)):  # on the CPU, whose caches a view fills
        found = surface.footprint(view[v : v + 1], None if drift is None else drift[v : v + 1])
        texels[v], weights[v] = found.texel[0], found.weight[0]
    return texels, weights


def _alone(texels: int, views: int) -> tuple[Tensor, Tensor]:
    """Texels and weights `[V, T, 4]` of pixels that show their own texel; views share memory."""
    shape = (views, texels, 4)
    texel = torch.arange(texels, dtype=torch.int32)[:, None].expand(shape)
    return texel, torch.tensor((1.0, 0.0, 0.0, 0.0)).expand(shape)
