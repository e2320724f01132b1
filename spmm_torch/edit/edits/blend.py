"""A mix of two models, texel by texel."""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor

from ...config.schema import REQUIRED, setting
from ...errors import ConfigError
from ...lobes.batch import LobeBatch
from ...model.residual import Residual, decode_residual, encode_residual
from ...model.spmm import SPMM
from ..entries import entry_texels, from_entries, scaled_entries
from ..residual import STEPS, share_steps
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

    Lobes blend exactly: each texel has those of both. The residual is stored by cluster, so where
    a share is neither 0 nor 1, each cluster of the model with the larger share gets the mean of
    the blended residuals of its texels, as the residual itself is a mean [WDR11 §4.1].

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
    labels, residual = _blended_residual(first, second, share)
    return from_entries(first, lobes, parts, labels, residual)


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
