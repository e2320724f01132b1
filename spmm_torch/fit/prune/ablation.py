"""Ablation of each BRDF model: the error of some texels that choose from the lobes of the others.

Texels choose again from the same dictionary without the lobes of one model. No lobes are searched
again to replace them, so the loss in SNR is an upper bound of what the model contributes.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import torch
from torch import Tensor

from ...brdf import MODEL_NAMES
from ...config.fit import FitConfig
from ...metrics import snr_db
from ...report.contract import Ablation
from ..dictionary import Dictionary
from ..problem import Problem
from ..select.products import Products, cluster_products
from ..select.target import target_beside_residual
from ..select.texels import Fit, select, squared_errors

# Texels of the ablation, drawn at random.
ABLATION_TEXELS = 128


def ablate(problem: Problem, labels: Tensor, dictionary: Dictionary) -> Ablation:
    """SNR of the lobes alone over some texels, with all models and without each of them.

    Args:
        problem: the fit, whose settings tell how texels choose.
        labels: cluster of every texel, `[T]`.
        dictionary: of all clusters.
    """
    context = problem.context
    with context.watch("evaluate"):
        return context.ranks.first(lambda: _ablation(problem, labels, dictionary))


def _ablation(problem: Problem, labels: Tensor, dictionary: Dictionary) -> Ablation:
    """`ablate` on one rank."""
    generator = problem.context.generator("worth")
    texels = torch.randperm(problem.btf.texel_count, generator=generator)[:ABLATION_TEXELS]
    groups = list(_groups(problem, texels, labels, dictionary))
    energy = sum(float(products.total(products.energy)) for products, _ in groups)

    def decibels(dropped: int | None) -> float:
        kept = (
            products if dropped is None else with_atoms(products, model != dropped)
            for products, model in groups
        )
        return snr_db(energy, sum(_error(products, problem) for products in kept))

    without = {MODEL_NAMES[model]: decibels(model) for model, _ in dictionary.lobes.by_model()}
    return Ablation(len(texels), decibels(None), without)


def _groups(
    problem: Problem, texels: Tensor, labels: Tensor, dictionary: Dictionary
) -> Iterator[tuple[Products, Tensor]]:
    """(products of texels that choose from the same lobes, models `[J]` of these lobes)."""
    shared = all(len(choice) == len(dictionary.lobes) for choice in dictionary.choices)
    owner = torch.zeros_like(texels) if shared else labels[texels]
    for cluster in torch.unique(owner).tolist():
        own, choice = texels[owner == cluster], dictionary.choices[cluster]
        products = cluster_products(
            lambda part, own=own: problem.signals(own[part]),
            [slice(0, len(own))],
            (len(own), problem.btf.channels),
            dictionary.atoms[choice],
            importance=problem.importance(own),
        )
        yield products, dictionary.lobes.model[choice]


def _error(products: Products, problem: Problem) -> float:
    """Squared error of the lobes alone, by the weights of the texels."""
    return float(products.total(squared_errors(products, selected(products, problem.config))))


def selected(products: Products, config: FitConfig) -> Fit:
    """The fit of every texel by the lobes alone, given products with `[J]` atoms."""
    target = target_beside_residual(products, None, 0.0)
    return select(products, target, config.select, config.stagewise)


def with_atoms(products: Products, kept: Tensor) -> Products:
    """The products with the atoms `kept [J]` bool only."""
    index = torch.nonzero(kept).squeeze(1).to(products.gram.device)
    return replace(
        products,
        gram=products.gram[index][:, index],
        correlation=products.correlation[:, index],
        mean_correlation=products.mean_correlation[index],
    )
