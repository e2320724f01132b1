"""Sharpness: how much of the original's gradients a model keeps.

Gradients are differences of neighbours in a row and in a column, in linear values. Their energy is
the sum of squares. Two shares of the original's energy are told, which are both 1 for the original
itself and both below 1 for a blurred one:

* that of the model's gradients, wherever they are: noise and made-up edges raise it, too;
* that of the model's gradients in place, <g_model, g_original> / <g_original, g_original>: only
  edges that the original has count, and noise does not.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor


@dataclass(frozen=True)
class GradientSums:
    """Sums over texels, channels and pictures.

    Attributes:
        original, model: energies of the gradients.
        product: inner product of both.
    """

    original: float = 0.0
    model: float = 0.0
    product: float = 0.0

    @classmethod
    def of(cls, original: Tensor, model: Tensor) -> GradientSums:
        """The sums of a pair of linear pictures `[H, W, C]`, in float64."""
        wanted, found = gradients(original), gradients(model)
        return cls(*(float(a @ b) for a, b in ((wanted, wanted), (found, found), (wanted, found))))

    def __add__(self, other: GradientSums) -> GradientSums:
        """The sums over the pictures of both."""
        return GradientSums(
            self.original + other.original,
            self.model + other.model,
            self.product + other.product,
        )

    @property
    def share(self) -> float | None:
        """The energy of the model's gradients over that of the original's; None if it is flat."""
        return self.model / self.original if self.original > 0.0 else None

    @property
    def share_in_place(self) -> float | None:
        """The same of gradients where the original has them; None if it is flat."""
        return self.product / self.original if self.original > 0.0 else None


def gradients(picture: Tensor) -> Tensor:
    """Differences of neighbours `[N]` float64 of a picture `[H, W, C]`, none across its border."""
    exact = picture.double()
    return torch.cat([exact.diff(dim=0).flatten(), exact.diff(dim=1).flatten()])
