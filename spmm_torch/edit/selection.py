"""What an edit acts on: a share of each entry of a model, and of the residual of each texel.

Masks of texels and properties of lobes become the same thing here, so that they combine:
`stripes & specular`, `~region | other`. An edit of lobes turns an entry of share m and weight
alpha into an edited one of weight m * alpha and an unedited one of (1 - m) * alpha.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from ..errors import ConfigError
from ..model.spmm import SPMM
from .parts import entry_texels


@dataclass(frozen=True)
class Selection:
    """Shares in [0, 1].

    Attributes:
        entries: of every entry of the model (texel, lobe), `[N]`.
        texels: of the residual of every texel, `[T]`; None where a property of lobes takes part,
            as the residual belongs to no lobe: edits then leave it alone.
    """

    entries: Tensor
    texels: Tensor | None

    def __and__(self, other: Selection) -> Selection:
        """What both select: the product of their shares."""
        return _combined(self, other, lambda a, b: a * b)

    def __or__(self, other: Selection) -> Selection:
        """What either selects: the larger share."""
        return _combined(self, other, torch.maximum)

    def __invert__(self) -> Selection:
        """What is not selected."""
        return Selection(1.0 - self.entries, None if self.texels is None else 1.0 - self.texels)


def _combined(first: Selection, second: Selection, combine) -> Selection:  # noqa: ANN001
    texels = None
    if first.texels is not None and second.texels is not None:
        texels = combine(first.texels, second.texels)
    return Selection(combine(first.entries, second.entries), texels)


def select_texels(model: SPMM, mask: Tensor) -> Selection:
    """All lobes and the residual of the texels of a mask.

    Args:
        mask: bool, or shares in [0, 1], `[H, W]` with row 0 at the top, or `[T]`.

    Raises:
        ConfigError: wrong size, or shares out of their range.
    """
    height, width = model.height, model.width
    if mask.shape not in ((height, width), (height * width,)):
        size = " x ".join(str(n) for n in reversed(mask.shape))
        raise ConfigError(
            f"the mask has {size} texels, the texture {width} x {height}; expected the same size; "
            f"scale the mask."
        )
    share = mask.flatten().to(model.weight)
    if not bool(((share >= 0.0) & (share <= 1.0)).all()):
        raise ConfigError("the mask holds values outside of 0 to 1; expected shares; scale them.")
    return Selection(share[entry_texels(model)], share)


def select_lobes(model: SPMM, lobes: Tensor) -> Selection:
    """The lobes of the dictionary where `lobes [J]` is true, in all texels, without residual.

    Raises:
        ConfigError: wrong size.
    """
    if lobes.shape != (len(model.lobe_model),):
        raise ConfigError(
            f"the choice of lobes has {lobes.numel()} values; expected one for each of the "
            f"{len(model.lobe_model)} lobes."
        )
    return Selection(lobes.to(model.weight)[model.index], None)
