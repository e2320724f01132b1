"""A mix of two models, texel by texel."""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor

from ...config.schema import REQUIRED, setting
from ...errors import ConfigError
from ...lobes.batch import LobeBatch
from ...model.components import Components
from ...model.relief import Relief
from ...model.residual import Residual, decode_residual, encode_residual
from ...model.spmm import SPMM
from ..components import mixed, scaled_components
from ..entries import entry_texels, from_entries, scaled_entries
from ..parts import with_parts
from ..residual import STEPS, WholeResidual, share_steps
from ..selection import EVERYTHING, Selection

# Directions of two models are the same where they differ by less than rounding does.
DIRECTION_TOLERANCE = 1e-4


@dataclass(frozen=True)
class Blend:
    """A mix with another model of the same size."""

    path: str = setting(REQUIRED, "a run folder or model file; relative to the script")
    amount: float = setting(0.5, "weight of the other model", low=0.0, high=1.0)

    def apply(self, model: SPMM, where: Selection) -> SPMM:
        """The edited model."""
        return blend(model, SPMM.load(self.path, model.weight.device), self.amount, where)


@torch.no_grad()
def blend(first: SPMM, second: SPMM, amount: float, where: Selection = EVERYTHING) -> SPMM:
    """(1 - amount) times one model plus `amount` times another, texel by texel.

    Lobes and components blend exactly: each texel has those of both. The residual of clusters is
    stored by cluster, so where a share is neither 0 nor 1, each cluster of the model with the
    larger share gets the mean of the blended residuals of its texels, as that residual itself is a
    mean [WDR11 §4.1]. Heights blend, too; a model without a relief has height 0.

    Args:
        first: the original.
        second: of the same size and channels, with the same measured directions.
        amount: weight of the second model, 0 to 1.
        where: whole texels of the first model; their shares multiply `amount`.

    Raises:
        ConfigError: models that do not fit each other, an amount out of its range, or a selection
            of some lobes.
    """
    _check_pair(first, second)
    if not 0.0 <= amount <= 1.0:
        raise ConfigError(f"the amount of a blend is {amount}; expected 0 to 1.")
    share = amount * where.texel_share(first, "a blend")
    if not bool((share > 0.0).any()):
        return first
    lobes, first_lobe = _joined(first, second)
    parts = [
        scaled_entries(model, part.index_select(0, entry_texels(model)), begin)
        for model, part, begin in ((first, 1.0 - share, 0), (second, share, first_lobe))
    ]
    blended = from_entries(first, lobes, parts, **vars(_blended_residual(first, second, share)))
    return with_parts(blended, relief=_blended_relief(first, second, share))


def _check_pair(first: SPMM, second: SPMM) -> None:
    sizes = [(model.width, model.height, model.weight.shape[1]) for model in (first, second)]
    if sizes[0] != sizes[1]:
        names = [f"{w} x {h} texels with {c} channels" for w, h, c in sizes]
        raise ConfigError(f"the models have {names[0]} and {names[1]}; a blend expects equal ones.")
    horizons = [math.degrees(model.horizon) for model in (first, second)]
    if horizons[0] != horizons[1]:
        raise ConfigError(
            f"lobes of the models fade over {horizons[0]:g} and {horizons[1]:g} degrees at their "
            f"horizon; a blend expects the same; fit both with one dictionary.horizon."
        )
    for name in ("light", "view"):
        one, two = getattr(first, name), getattr(second, name)
        if one.shape != two.shape or not torch.allclose(one, two, atol=DIRECTION_TOLERANCE):
            raise ConfigError(
                f"the models were measured under different {name} directions; a blend expects the "
                f"same; fit both to the same directions."
            )


def _joined(first: SPMM, second: SPMM) -> tuple[LobeBatch, int]:
    """Both dictionaries in one, and the place of the second's first lobe.

    Models that share the storage of their lobes keep one dictionary.
    """
    parts = [(model.kappa, model.normal, model.angle) for model in (first, second)]
    if all(one.data_ptr() == two.data_ptr() for one, two in zip(*parts, strict=True)):
        return first.dictionary.detach(), 0
    lobes = LobeBatch.cat((first.dictionary.detach(), second.dictionary.detach()))
    return lobes, len(first.lobe_model)


def _blended_relief(first: SPMM, second: SPMM, share: Tensor) -> Relief | None:
    """The relief of a blend with shares `[T]` of the second model; None if neither has one."""
    relief = first.relief or second.relief
    if relief is None:
        return None
    heights = [
        torch.zeros_like(share) if each.relief is None else each.relief.heights(len(share))
        for each in (first, second)
    ]
    return relief.with_heights(torch.lerp(heights[0].to(share), heights[1].to(share), share))


def _blended_residual(first: SPMM, second: SPMM, share: Tensor) -> WholeResidual:
    """The residual of a blend with shares `[T]` of the second model."""
    labels, residual = _blended_clusters(first, second, share)
    return WholeResidual(labels, residual, _blended_components(first, second, share))


def _blended_components(first: SPMM, second: SPMM, share: Tensor) -> Components | None:
    """The components of a blend with shares `[T]` of the second model."""
    one, two = first.components, second.components
    if one is not None and two is not None:
        return mixed((one, two), (1.0 - share, share))
    if one is not None:
        return scaled_components(one, 0.0, share)
    return two and scaled_components(two, 0.0, 1.0 - share)


def _blended_clusters(first: SPMM, second: SPMM, share: Tensor) -> tuple[Tensor, Residual]:
    """Labels `[T]` and residual of clusters of a blend with shares `[T]` of the second model."""
    label = torch.where(share > 0.5, second.labels + first.cluster_count, first.labels)
    if not len(first.residual.code) and not len(second.residual.code):
        return torch.unique(label, return_inverse=True)[1], first.residual
    step = share_steps(share)
    keys, label = torch.unique(label * (STEPS + 2) + step, return_inverse=True)
    total = first.cluster_count + second.cluster_count
    mixing = share.new_zeros(len(keys), total)  # [G, K1 + K2]
    flat = mixing.view(-1)
    flat.index_add_(0, label * total + first.labels, 1.0 - share)
    flat.index_add_(0, label * total + first.cluster_count + second.labels, share)
    mixing = mixing / torch.bincount(label, minlength=len(keys))[:, None]
    values = torch.cat([_of_clusters(model) for model in (first, second)])
    blended = torch.einsum("gk,kvlc->gvlc", mixing.to(values), values)
    return label, first.residual.with_codes(*encode_residual(blended, first.residual.code.dtype))


def _of_clusters(model: SPMM) -> Tensor:
    """The residual of each cluster, `[K, V, L, C]`; 0 where clusters have none."""
    residual = model.residual
    if len(residual.code):
        return decode_residual(residual.code, residual.scale)
    return residual.scale.new_zeros(model.cluster_count, *residual.code.shape[1:])
