"""What an edit acts on: which texels, which lobes, and which share of them.

A mask and a group of lobes make one `Selection`: `stripes & lobe_group(model, "specular")`. Masks
combine first: `(stripes | ~region) & group`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import torch
from torch import Tensor

from ..errors import ConfigError
from ..model.spmm import SPMM
from .entries import entry_texels


@dataclass(frozen=True)
class Selection:
    """Shares in [0, 1] of entries and texels, and a group of lobes; an entry is a lobe in a texel.

    An edit turns an entry of share m and weight alpha into an edited one of weight m * alpha and
    an unedited one of weight (1 - m) * alpha.

    Attributes:
        entries: share of each entry that the mask selects, `[N]`; None without a mask.
        texels: share of each texel that the mask selects, `[T]`; None without a mask, and where
            the mask selects by a property of lobes.
        lobes: true for each lobe of the group, `[J]`; None for all lobes.
    """

    entries: Tensor | None = None
    texels: Tensor | None = None
    lobes: Tensor | None = None

    @property
    def masks_texels(self) -> bool:
        """Whether the mask treats all lobes of a texel alike."""
        return self.entries is None or self.texels is not None

    @property
    def reaches_residual(self) -> bool:
        """Whether the residual is edited: it belongs to a texel, and to none of its lobes."""
        return self.masks_texels and self.lobes is None

    def entry_share(self, model: SPMM) -> Tensor | None:
        """The share of each entry by mask and group, `[N]`; None where all are selected fully."""
        if self.lobes is None:
            return self.entries
        chosen = self.lobes[model.index].to(model.weight)
        return chosen if self.entries is None else chosen * self.entries

    def texel_share(self, model: SPMM, action: str) -> Tensor:
        """The share of each texel, `[T]`.

        Args:
            model: gives the number of texels.
            action: name of the edit in the error message.

        Raises:
            ConfigError: some lobes of a texel are selected and others are not.
        """
        if not self.reaches_residual:
            raise ConfigError(
                f"{action} takes whole texels; expected a mask without lobe properties."
            )
        if self.texels is None:
            return torch.ones_like(model.labels, dtype=model.weight.dtype)
        return self.texels

    def __and__(self, other: Selection) -> Selection:
        """What both select: the product of their shares, and the lobes in both groups."""
        texels = None
        if self.masks_texels and other.masks_texels:
            texels = _joined(self.texels, other.texels, torch.mul)
        entries = _joined(self.entries, other.entries, torch.mul)
        return Selection(entries, texels, _joined(self.lobes, other.lobes, torch.logical_and))

    def __or__(self, other: Selection) -> Selection:
        """What either of two masks selects: the larger share.

        Raises:
            ConfigError: one of them is no plain mask.
        """
        texels = None
        if self.texels is not None and other.texels is not None:
            texels = torch.maximum(self.texels, other.texels)
        return Selection(torch.maximum(_mask(self), _mask(other)), texels)

    def __invert__(self) -> Selection:
        """What a mask does not select.

        Raises:
            ConfigError: this is no plain mask.
        """
        return Selection(1.0 - _mask(self), None if self.texels is None else 1.0 - self.texels)


# The whole texture, with all lobes and the residual.
EVERYTHING = Selection()


def select_texels(model: SPMM, mask: Tensor) -> Selection:
    """All lobes and the residual of the texels of a mask.

    Args:
        model: whose texels are selected.
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
    """A mask of lobes: those where `lobes [J]` is true, in all texels, without the residual.

    Raises:
        ConfigError: wrong size.
    """
    if lobes.shape != (len(model.lobe_model),):
        raise ConfigError(
            f"the choice of lobes has {lobes.numel()} values; expected one for each of the "
            f"{len(model.lobe_model)} lobes."
        )
    return Selection(lobes.to(model.weight)[model.index])


def _joined(
    first: Tensor | None, second: Tensor | None, combine: Callable[[Tensor, Tensor], Tensor]
) -> Tensor | None:
    """Two optional tensors of equal shape combined; None leaves the other one as it is."""
    if first is None or second is None:
        return second if first is None else first
    return combine(first, second)


def _mask(selection: Selection) -> Tensor:
    """The entries `[N]` of a plain mask."""
    if selection.entries is None or selection.lobes is not None:
        raise ConfigError(
            "only masks can be joined by | or inverted by ~; combine masks first, then keep them "
            "to a group of lobes by &."
        )
    return selection.entries
