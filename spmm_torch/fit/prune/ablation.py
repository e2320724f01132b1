"""What every BRDF model buys: the error of some texels that choose their lobes without it.

The dictionary stays as it is but for the lobes of one model, and texels choose anew in dictionary
space. Nothing is searched anew, so the others could not yet make up for it: what is told is the
most that a model can be worth.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import torch
from torch import Tensor

from ...brdf import MODEL_NAMES
from ...config.fit import FitConfig
from ...data import BTF
from ...data.error_weights import Weights
from ...metrics import snr_db
from ..dictionary import Dictionary
from ..select.products import cluster_products
from ..select.texels import Fit, Products, select, squared_errors, target_beside_residual

# Texels that are looked at, drawn at random.
TEXELS = 128


def worth_of_models(
    btf: BTF,
    labels: Tensor,
    dictionary: Dictionary,
    config: FitConfig,
    weights: Weights,
    generator: torch.Generator,
) -> dict[str, Any]:
    """Signal-to-noise ratios of lobes alone over some texels, by weight.

    Args:
        btf: the values.
        labels: cluster of every texel, `[T]`.
        dictionary: of all clusters.
        config: of the fit; its way to select is taken.
        weights: of the fit.
        generator: draws the texels.

    Returns:
        `texels`, their number; `snr_db` with all models; and `snr_db_without`, that without each
        model that the dictionary has lobes of.
    """
    texels = torch.randperm(btf.texel_count, generator=generator)[:TEXELS]
    groups = list(_groups(btf, texels, labels, dictionary, weights))
    energy = sum(float(products.total(products.energy)) for products, _ in groups)
    present = torch.unique(dictionary.lobes.model).tolist()
    errors = {
        index: sum(_error(products, model != index, config) for products, model in groups)
        for index in (None, *present)
    }
    without = {MODEL_NAMES[index]: snr_db(energy, errors[index]) for index in present}
    return {
        "texels": len(texels),
        "snr_db": snr_db(energy, errors[None]),
        "snr_db_without": without,
    }


def _groups(
    btf: BTF, texels: Tensor, labels: Tensor, dictionary: Dictionary, weights: Weights
) -> Iterator[tuple[Products, Tensor]]:
    """Products of texels that choose from the same lobes, and the models of those `[J]`."""
    device = dictionary.atoms.device
    shared = all(len(choice) == len(dictionary.lobes) for choice in dictionary.choices)
    owner = torch.zeros_like(texels) if shared else labels[texels]
    for cluster in torch.unique(owner).tolist():
        own, choice = texels[owner == cluster], dictionary.choices[cluster]
        products = cluster_products(
            lambda part, own=own: weights.signals(btf, own[part], device),
            [slice(0, len(own))],
            (len(own), btf.channels),
            dictionary.atoms[choice.to(device)],
            importance=weights.of_texels(own, device),
        )
        yield products, dictionary.lobes.model[choice]


def _error(products: Products, kept: Tensor | bool, config: FitConfig) -> float:
    """The squared error that lobes `kept [J]` leave; all of them if that is True."""
    if isinstance(kept, Tensor):
        products = with_atoms(products, kept)
    return float(products.total(squared_errors(products, selected(products, config))))


def selected(products: Products, config: FitConfig) -> Fit:
    """The lobes of every texel, without a residual beside them."""
    target = target_beside_residual(products, None, 0.0)
    return select(products, target, config.select, config.stagewise)


def with_atoms(products: Products, kept: Tensor) -> Products:
    """The products with the atoms `kept [J]` only."""
    index = torch.nonzero(kept).squeeze(1).to(products.gram.device)
    return replace(
        products,
        gram=products.gram[index][:, index],
        correlation=products.correlation[:, index],
        mean_correlation=products.mean_correlation[index],
    )
