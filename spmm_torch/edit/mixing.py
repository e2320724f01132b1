"""Two looks in one: blending two models, and copying one region of a texture to another."""

from __future__ import annotations

import torch
from torch import Tensor

from ..errors import ConfigError
from ..lobes.batch import LobeBatch
from ..lobes.ragged import ranges
from ..model.residual import Residual, decode_residual, encode_residual
from ..model.spmm import SPMM, SparseWeights
from .parts import entry_texels, from_entries, scaled_entries, with_parts
from .regions import Rectangle, bounds
from .residual import STEPS, share_steps
from .selection import Selection

# Directions of two models are the same where they differ by less than rounding does.
DIRECTION_TOLERANCE = 1e-4


@torch.no_grad()
def blend(first: SPMM, second: SPMM, amount: float, where: Selection | None = None) -> SPMM:
    """(1 - amount) times one model plus `amount` times another, texel by texel.

    Lobes blend exactly: each texel has those of both. The residual is stored by cluster, so where
    a share is neither 0 nor 1, each cluster of the model that has the larger share gets the mean
    of the blended residuals of its texels, as the residual itself is a mean [WDR11 §4.1].

    Args:
        first, second: of the same size and channels, with the same measured directions.
        amount: 0 to 1.
        where: of the first model; its shares of texels multiply `amount`. None for all.

    Raises:
        ConfigError: models that do not fit each other, an amount out of its range, or a selection
            by properties of lobes.
    """
    _check_pair(first, second)
    if not 0.0 <= amount <= 1.0:
        raise ConfigError(f"the amount of a blend is {amount}; expected 0 to 1.")
    share = amount * texel_share(first, where, "a blend")
    if not bool((share > 0.0).any()):
        return first
    lobes, shift = _joined(first, second)
    parts = [
        scaled_entries(model, part.index_select(0, entry_texels(model)), begin)
        for model, part, begin in ((first, 1.0 - share, 0), (second, share, shift))
    ]
    labels, residual = _blended_residual(first, second, share)
    return from_entries(first, lobes, parts, labels, residual)


@torch.no_grad()
def copy_look(model: SPMM, source: Rectangle, where: Selection | None = None) -> SPMM:
    """Gives the selected texels the look of a region, which is repeated over them as tiles.

    The region's top left corner comes to that of the selection. Soft shares blend; lobes and the
    residual are treated as by `blend`.

    Args:
        source: the region.
        where: what is overwritten; None for the whole texture.

    Raises:
        ConfigError: the region reaches out of the texture, or a selection by properties of lobes.
    """
    source.check(model)
    share = texel_share(model, where, "copying a look")
    if not bool((share > 0.0).any()):
        return model
    target = bounds(share.view(model.height, model.width) > 0.0)
    rows, columns = (torch.arange(n, device=share.device) for n in (model.height, model.width))
    row = source.y + (rows - target.y) % source.height
    column = source.x + (columns - target.x) % source.width
    origin = (row[:, None] * model.width + column).flatten()
    return blend(model, rearranged(model, origin), 1.0, where)


def rearranged(model: SPMM, origin: Tensor) -> SPMM:
    """The model whose texel t is the texel `origin[t]` of another, `[T]`."""
    count = model.lobe_count_per_texel()[origin]
    offset = torch.cat((count.new_zeros(1), count.cumsum(0)))
    _, entry = ranges(model.offset[origin], count)
    index, weight = (each.index_select(0, entry) for each in (model.index, model.weight.detach()))
    weights = SparseWeights(offset, index, weight)
    return with_parts(model, weights=weights, labels=model.labels[origin])


def texel_share(model: SPMM, where: Selection | None, what: str) -> Tensor:
    """The share `[T]` of each texel.

    Raises:
        ConfigError: the selection is one of lobes.
    """
    if where is None:
        return torch.ones_like(model.labels, dtype=model.weight.dtype)
    if where.texels is None:
        raise ConfigError(f"{what} takes whole texels; expected a mask without lobe properties.")
    return where.texels


def _check_pair(first: SPMM, second: SPMM) -> None:
    sizes = [(model.width, model.height, model.weight.shape[1]) for model in (first, second)]
    if sizes[0] != sizes[1]:
        names = [f"{w} x {h} texels with {c} channels" for w, h, c in sizes]
        raise ConfigError(f"the models have {names[0]} and {names[1]}; a blend expects equal ones.")
    for name in ("light", "view"):
        one, two = getattr(first, name), getattr(second, name)
        if one.shape != two.shape or not torch.allclose(one, two, atol=DIRECTION_TOLERANCE):
            raise ConfigError(
                f"the models were measured under different {name} directions; a blend expects the "
                f"same; fit both to the same directions."
            )


def _joined(first: SPMM, second: SPMM) -> tuple[LobeBatch, int]:
    """Both dictionaries in one, and where the second begins; one where they share their storage."""
    parts = [(model.kappa, model.normal, model.angle) for model in (first, second)]
    if all(one.data_ptr() == two.data_ptr() for one, two in zip(*parts, strict=True)):
        return first.dictionary.detach(), 0
    lobes = LobeBatch.cat((first.dictionary.detach(), second.dictionary.detach()))
    return lobes, len(first.lobe_model)


def _blended_residual(first: SPMM, second: SPMM, share: Tensor) -> tuple[Tensor, Residual]:
    """Labels `[T]` and residual of a blend with shares `[T]` of the second model."""
    step = share_steps(share)
    of_second = share > 0.5
    label = torch.where(of_second, second.labels + first.cluster_count, first.labels)
    keys, label = torch.unique(label * (STEPS + 2) + step, return_inverse=True)
    total = first.cluster_count + second.cluster_count
    mixing = share.new_zeros(len(keys), total)  # [G, K1 + K2]
    flat = mixing.view(-1)
    flat.index_add_(0, label * total + first.labels, 1.0 - share)
    flat.index_add_(0, label * total + first.cluster_count + second.labels, share)
    mixing = mixing / torch.bincount(label, minlength=len(keys))[:, None]
    residuals = (first.residual, second.residual)
    values = torch.cat([decode_residual(each.code, each.scale) for each in residuals])
    blended = torch.einsum("gk,kvlc->gvlc", mixing.to(values), values)
    return label, first.residual.with_codes(*encode_residual(blended, first.residual.code.dtype))
