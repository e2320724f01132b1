"""What each pixel of each view shows: the sparse matrices W_v, their transposes and squares.

Pixel p of view v shows sum_q W_v[p, q] f_q(v, .), with four entries a row: the bilinear lookup at
the surface point that the pixel sees.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import torch
from torch import Tensor

from ...geometry.relief import HeightField
from ...runtime.sparse import csr_matrix
from .matrices import matrix_of

# Pairs of corners of a 2 x 2 block, a before b: corners are in the order of rows.
CORNER_PAIRS = tuple((a, b) for a in range(4) for b in range(a, 4))
# Neighbours of a texel that its pixels may share, half of the 3 x 3 around it: (rows, columns).
HALF = ((0, 0), (0, 1), (1, -1), (1, 0), (1, 1))


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
    _gathered: dict[int, Tensor] = field(default_factory=dict, repr=False, compare=False)

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

    def squared(self, view: int, values: Tensor) -> Tensor:
        """W_v^T W_v times values `[T, R]`."""
        if not self.mixed:
            return values * self.weight[view].square().sum(1)[:, None]
        return self.gathered(view) @ (self.drawn(view) @ values)

    @property
    def views(self) -> int:
        """V."""
        return len(self.texel)

    def drawn(self, view: int) -> Tensor:
        """W_v, sparse CSR `[T, T]`: from texels to pixels."""
        texels = self.texel.shape[1]
        rows = torch.arange(0, 4 * texels + 1, 4, dtype=torch.int32, device=self.texel.device)
        weight = self.weight[view].flatten()
        return csr_matrix(rows, self.texel[view].flatten(), weight, (texels, texels))

    def gathered(self, view: int) -> Tensor:
        """W_v^T, sparse CSR `[T, T]`: from pixels to texels; kept, as every step needs it."""
        view = view if self.mixed else 0  # all views of a flat surface show the same
        if view not in self._gathered:
            self._gathered[view] = self._transposed(view)
        return self._gathered[view]

    def _transposed(self, view: int) -> Tensor:
        """`gathered`, made anew."""
        texels = self.texel.shape[1]
        pixel = torch.arange(texels, device=self.texel.device).repeat_interleave(4)
        texel, weight = self.texel[view].flatten(), self.weight[view].flatten()
        return matrix_of(texel, pixel, weight, (texels, texels))

    def squares(self) -> Tensor:
        """W_v^T W_v of all views, `[V, T, 5]`: of each texel and its neighbours in `HALF`."""
        views, texels = self.texel.shape[:2]
        table = torch.zeros(views, texels * len(HALF), device=self.texel.device)
        for own, texel, weight in zip(table, self.texel, self.weight, strict=True):
            self._add_squares(own, texel, weight)  # what a view takes stays in the caches
        return table.view(views, texels, len(HALF))

    def _add_squares(self, table: Tensor, texel: Tensor, weight: Tensor) -> None:
        """Adds those of one view to `table [T 5]`, given its texels and weights `[T, 4]`."""
        row, column = texel // self.width, texel % self.width
        for a, b in CORNER_PAIRS:
            # Equal at the border of a mirrored texture, and in one of a single row or column.
            down = (row[:, a] != row[:, b]).long()  # [T]
            right = (column[:, a] != column[:, b]) * (b % 2 - a % 2)
            back = (down == 0) & (right < 0)  # (0, -1) is (0, 1) of the other corner
            first = torch.where(back, texel[:, b], texel[:, a]).long()
            right = torch.where(back, 1, right)
            slot = torch.where(down > 0, 3 + right, right)
            product = weight[:, a] * weight[:, b]
            if a != b:  # both orders fall on one texel
                product = torch.where((down == 0) & (right == 0), 2.0 * product, product)
            table.scatter_add_(0, first * len(HALF) + slot, product)


def _seen(surface: HeightField, view: Tensor, drift: Tensor | None) -> tuple[Tensor, Tensor]:
    """Texels `[V, T, 4]` int32 and weights `[V, T, 4]` of views `[V, 3]` that drift `[V, 2]`."""
    texels, weights = [], []
    for v in range(len(view)):  # a view has texels enough to fill a device
        found = surface.footprint(view[v : v + 1], None if drift is None else drift[v : v + 1])
        texels.append(found.texel[0].int())
        weights.append(found.weight[0].float())
    return torch.stack(texels), torch.stack(weights)


def _alone(texels: int, views: int) -> tuple[Tensor, Tensor]:
    """Texels and weights `[V, T, 4]` of pixels that show their own texel; views share memory."""
    shape = (views, texels, 4)
    texel = torch.arange(texels, dtype=torch.int32)[:, None].expand(shape)
    return texel, torch.tensor((1.0, 0.0, 0.0, 0.0)).expand(shape)
