"""What each pixel of each view shows: the sparse matrices W_v, their transposes and squares.

Pixel p of view v shows sum_q W_v[p, q] f_q(v, .), with four entries a row: the bilinear lookup at
the surface point that the pixel sees.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from ...geometry.relief import HeightField

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

    @classmethod
    def build(
        cls,
        field: HeightField,
        view: Tensor,
        drift: Tensor | None,
        importance: Tensor | None,
        device: torch.device,
    ) -> Lookups:
        """The lookups through a relief.

        Args:
            field: heights of the surface.
            view: `[V, 3]`.
            drift: registration of each picture, `[V, 2]`; None: 0.
            importance: weights of the pixels, `[T]`; None: 1.
            device: where the lookups lie.
        """
        count, mixed = field.height.numel(), bool((field.height != 0.0).any()) or drift is not None
        pixel = None if importance is None else importance.float().sqrt()
        own = torch.arange(count, dtype=torch.int32)[:, None].expand(count, 4)
        alone = torch.tensor((1.0, 0.0, 0.0, 0.0)).expand(count, 4)
        texels, weights = [], []
        for v in range(len(view)):  # a view has texels enough to fill a device
            texel, weight = own, alone
            if mixed:
                moved = None if drift is None else drift[v : v + 1]
                found = field.footprint(view[v : v + 1], moved)
                texel, weight = found.texel[0].int(), found.weight[0].float()
            texels.append(texel)
            weights.append(weight if pixel is None else weight * pixel[:, None])
        pixel = None if pixel is None else pixel.to(device)
        height, width = field.height.shape
        texel, weight = torch.stack(texels).to(device), torch.stack(weights).to(device)
        return cls(texel, weight, height, width, mixed, pixel)

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
        return _csr(rows, self.texel[view].flatten(), self.weight[view].flatten(), texels)

    def gathered(self, view: int) -> Tensor:
        """W_v^T, sparse CSR `[T, T]`: from pixels to texels."""
        texels = self.texel.shape[1]
        order = torch.argsort(self.texel[view].flatten(), stable=True)
        count = torch.bincount(self.texel[view].flatten(), minlength=texels)
        rows = torch.cat((count.new_zeros(1), count.cumsum(0))).int()
        pixel = order.div(4, rounding_mode="floor").int()
        return _csr(rows, pixel, self.weight[view].flatten()[order], texels)

    def squares(self) -> Tensor:
        """W_v^T W_v of all views, `[V, T, 5]`: of each texel and its neighbours in `HALF`."""
        views, texels = self.texel.shape[:2]
        table = torch.zeros(views, texels * len(HALF), device=self.texel.device)
        row, column = self.texel // self.width, self.texel % self.width
        for a, b in CORNER_PAIRS:
            # Equal at the border of a mirrored texture, and in one of a single row or column.
            down = (row[..., a] != row[..., b]).long()  # [V, T]
            right = (column[..., a] != column[..., b]) * (b % 2 - a % 2)
            back = (down == 0) & (right < 0)  # (0, -1) is (0, 1) of the other corner
            first = torch.where(back, self.texel[..., b], self.texel[..., a]).long()
            right = torch.where(back, 1, right)
            slot = torch.where(down > 0, 3 + right, right)
            product = self.weight[..., a] * self.weight[..., b]
            if a != b:  # both orders fall on one texel
                product = torch.where((down == 0) & (right == 0), 2.0 * product, product)
            table.scatter_add_(1, first * len(HALF) + slot, product)
        return table.view(views, texels, len(HALF))


def _csr(rows: Tensor, columns: Tensor, values: Tensor, size: int) -> Tensor:
    """A square sparse matrix; its indices are valid as they were made."""
    return torch.sparse_csr_tensor(rows, columns, values, (size, size), check_invariants=False)
