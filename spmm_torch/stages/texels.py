"""Stages select, refit and residual over all texels, one cluster at a time [WDR11 §4.1]."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from ..config import FitConfig
from ..data import BTF
from ..metrics import Totals
from ..residual import decode_residual, encode_residual
from ..stopwatch import Stopwatch
from .cluster import BLOCK_VALUES, Advance
from .dictionary import Dictionary
from .select import (
    Fit,
    Products,
    cluster_products,
    refit,
    residual_share,
    select,
    squared_errors,
    target_beside_residual,
)

# Share of the energy that rounding in float32 may leave of texels that their mean fits exactly.
ROUNDING = 1e-6
PRECISIONS = {"float16": torch.float16, "float32": torch.float32}


@dataclass(frozen=True)
class ClusterFit:
    """The fit of one cluster of n texels.

    Attributes:
        index: lobes of the dictionary `[n, M]`, -1 for padding.
        weights: `[n, M, C]`, of lobes as they are (not of unit norm).
        code: the stored residual `[D, C]`.
        scale: its scale `[]`.
        totals: squared errors of the cluster.
    """

    index: Tensor
    weights: Tensor
    code: Tensor
    scale: Tensor
    totals: Totals


def fit_texels(
    btf: BTF,
    members: list[Tensor],
    dictionary: Dictionary,
    config: FitConfig,
    watch: Stopwatch,
    advance: Advance,
) -> list[ClusterFit]:
    """Fits the texels of every cluster with the lobes open to it, and their residual."""
    fits = []
    for texels, choice in zip(members, dictionary.choices, strict=True):
        fits.append(_fit_cluster(btf, texels, choice, dictionary, config, watch))
        advance(len(texels))
    return fits


def _fit_cluster(
    btf: BTF,
    texels: Tensor,
    choice: Tensor,
    dictionary: Dictionary,
    config: FitConfig,
    watch: Stopwatch,
) -> ClusterFit:
    device = dictionary.atoms.device
    where = choice.to(device)
    atoms = dictionary.atoms[where]
    with watch("select"):
        products = _products(btf, texels, atoms)
        target = target_beside_residual(products, None, 0.0)
        fit = select(products, target, config.select, config.stagewise)
    if config.residual.joint:
        fit = _fit_jointly(products, fit, config, watch)
    with watch("residual"):
        residual = products.mean - atoms.T @ fit.mean_weights(len(atoms))  # [D, C]
        code, scale = encode_residual(residual[None], PRECISIONS[config.residual.precision])
        rounding = (decode_residual(code, scale)[0] - residual).double().square().sum()
    with watch("evaluate"):
        error, taken = squared_errors(products, fit)
        totals = Totals(
            energy=float(products.energy.sum()),
            without_residual=float(error.sum()),
            with_residual=float((error.sum() - taken).clamp(min=0.0) + len(texels) * rounding),
            cluster_mean=float(products.energy.sum() - len(texels) * products.mean_energy.sum()),
        )
    lobe = torch.where(fit.index >= 0, where[fit.index.clamp(min=0)], -1)  # [n, M]
    weights = fit.weights / dictionary.norm[lobe.clamp(min=0)][..., None]
    return ClusterFit(lobe.cpu(), weights.cpu(), code[0].cpu(), scale[0].cpu(), totals)


def _products(btf: BTF, texels: Tensor, atoms: Tensor) -> Products:
    """The products of all texels of a cluster, in blocks that fit the memory."""
    size = max(1, BLOCK_VALUES // (btf.pair_count * btf.channels))
    return cluster_products(
        (btf.texels(block, atoms.device) for block in texels.split(size)), atoms
    )


def _fit_jointly(products: Products, fit: Fit, config: FitConfig, watch: Stopwatch) -> Fit:
    """Chooses again beside the residual, then fits weights and residual in turn.

    If even so the residual leaves more error than the bare mean of the cluster, the weights are
    fit to the deviations from that mean: from there every turn can only improve.
    """
    error, taken = squared_errors(products, fit)
    share = residual_share(float(error.sum()), float(taken), len(error))
    fit = _alternate(products, fit, share, config, watch)
    error, taken = squared_errors(products, fit)
    of_mean = products.energy.sum() - len(error) * products.mean_energy.sum()
    slack = ROUNDING * float(products.energy.sum())
    if float(error.sum() - taken) > float(of_mean) + slack:
        fit = _alternate(products, None, 1.0, config, watch)
    return fit


def _alternate(
    products: Products, fit: Fit | None, share: float, config: FitConfig, watch: Stopwatch
) -> Fit:
    with watch("select"):
        target = target_beside_residual(products, fit, share)
        fit = select(products, target, config.select, config.stagewise)
    with watch("refit"):
        for _ in range(config.residual.alternations):
            fit = refit(products, fit, target_beside_residual(products, fit, share))
    return fit
