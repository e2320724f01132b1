"""A model with some of its parts replaced; all others are shared with the original."""

from __future__ import annotations

import torch
from torch import Tensor

from ..errors import ConfigError
from ..lobe import LobeBatch
from ..model import SPMM, SparseWeights
from ..residual import Residual


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


def from_entries(
    model: SPMM,
    lobes: LobeBatch,
    entries: tuple[Tensor, Tensor, Tensor],
    labels: Tensor | None = None,
    residual: Residual | None = None,
) -> SPMM:
    """A model of the same size with other entries; lobes that no entry uses are left out.

    Args:
        model: gives the size and all parts that are not given.
        lobes: a dictionary of J lobes.
        entries: texel `[N]`, lobe `[N]` and weight `[N, C]`, in any order. Those of a texel keep
            their order.
        labels, residual: as in `with_parts`.
    """
    texel, index, weight = entries
    order = torch.argsort(texel, stable=True)
    count = torch.bincount(texel, minlength=model.texel_count)
    offset = torch.cat((count.new_zeros(1), count.cumsum(0)))
    used = torch.bincount(index, minlength=len(lobes)) > 0  # [J]
    place = used.cumsum(0) - 1
    weights = SparseWeights(offset, place[index[order]], weight[order])
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
