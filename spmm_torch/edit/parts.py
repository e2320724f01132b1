"""A model with some of its parts replaced; all others are shared with the original."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from ..errors import ConfigError
from ..lobes.batch import LobeBatch
from ..model.residual import Residual
from ..model.spmm import SPMM, SparseWeights


@dataclass(frozen=True)
class Entries:
    """n entries of a model, in the order of their texels.

    Attributes:
        texel: ascending, `[n]`.
        lobe: of a dictionary, `[n]`.
        weight: `[n, C]`.
    """

    texel: Tensor
    lobe: Tensor
    weight: Tensor


def with_parts(
    model: SPMM,
    *,
    lobes: LobeBatch | None = None,
    weights: SparseWeights | None = None,
    labels: Tensor | None = None,
    residual: Residual | None = None,
) -> SPMM:
    """A model that has the given parts, and shares the tensors of all others with `model`."""
    return SPMM(
        model.height,
        model.width,
        (model.dictionary if lobes is None else lobes).detach(),
        weights or model.sparse_weights,
        model.labels if labels is None else labels,
        residual or model.residual,
        model.light,
        model.view,
        model.name,
    )


def entry_texels(model: SPMM) -> Tensor:
    """The texel of each entry, `[N]`."""
    return torch.repeat_interleave(model.lobe_count_per_texel())


def scaled_entries(model: SPMM, share: Tensor, begin: int = 0) -> Entries:
    """The entries of a model with their weights times `share [N]`, without those of share 0.

    Args:
        begin: is added to the numbers of the lobes.
    """
    texel, lobe, weight = entry_texels(model), model.index + begin, model.weight * share[:, None]
    if bool((share > 0.0).all()):
        return Entries(texel, lobe, weight)
    kept = torch.nonzero(share > 0.0).squeeze(-1)
    return Entries(*(part.index_select(0, kept) for part in (texel, lobe, weight)))


def from_entries(
    model: SPMM,
    lobes: LobeBatch,
    parts: Sequence[Entries],
    labels: Tensor | None = None,
    residual: Residual | None = None,
) -> SPMM:
    """A model of the same size with other entries; lobes that no entry uses are left out.

    Args:
        model: gives the size and all parts that are not given.
        lobes: a dictionary of J lobes.
        parts: entries by texel; those of a texel stay in the order of the parts. Merged by
            counting, as each part is in order already.
        labels, residual: as in `with_parts`.
    """
    counts = [torch.bincount(part.texel, minlength=model.texel_count) for part in parts]
    total = torch.stack(counts).sum(0)  # [T]
    offset = torch.cat((total.new_zeros(1), total.cumsum(0)))
    index = total.new_empty(sum(len(part.texel) for part in parts))
    weight = model.weight.new_empty(len(index), model.weight.shape[1])
    start = offset[:-1]  # [T], where each texel's entries of a part begin
    for part, count in zip(parts, counts, strict=True):
        shift = start - (count.cumsum(0) - count)
        number = torch.arange(len(part.texel), device=index.device)
        place = number + shift.index_select(0, part.texel)
        index.index_copy_(0, place, part.lobe)
        weight.index_copy_(0, place, part.weight)
        start = start + count
    used = torch.bincount(index, minlength=len(lobes)) > 0  # [J]
    position = used.cumsum(0) - 1
    weights = SparseWeights(offset, position.index_select(0, index), weight)
    return with_parts(model, lobes=lobes[used], weights=weights, labels=labels, residual=residual)


def check_colours(model: SPMM) -> None:
    """Checks that a model has the three channels of RGB.

    Raises:
        ConfigError: it has not.
    """
    channels = model.weight.shape[1]
    if channels != 3:
        raise ConfigError(
            f"the model has {channels} channels; a change of hue or saturation expects the three "
            f"of RGB; leave this edit out."
        )


def check_factor(name: str, factor: float) -> None:
    """Checks a factor on weights or widths.

    Raises:
        ConfigError: negative or not finite.
    """
    if not 0.0 <= factor < float("inf"):
        raise ConfigError(f"{name} is {factor}; expected a finite number not below 0.")
