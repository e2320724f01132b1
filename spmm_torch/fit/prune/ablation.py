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
from ..select.target import Target, target_beside_residual
from ..select.texels import Fit, select, squared_errors
from ..select.together import closed

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

    models = [model for model, _ in dictionary.lobes.by_model()]
    rows = [_errors(products, model, models, problem) for products, model in groups]
    whole, *without = (snr_db(energy, sum(errors)) for errors in zip(*rows, strict=True))
    names = (MODEL_NAMES[model] for model in models)
    return Ablation(len(texels), whole, dict(zip(names, without, strict=True)))


def _groups(
    problem: Problem, texels: Tensor, labels: Tensor, dictionary: Dictionary
) -> Iterator[tuple[Products, Tensor]]:
    """(products of texels that choose from the same lobes, models `[J]` of these lobes)."""
    owner = torch.zeros_like(texels) if dictionary.is_shared else labels[texels]
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


def _errors(products: Products, model: Tensor, dropped: list[int], problem: Problem) -> list[float]:
    """Squared errors with all lobes, of models `[J]`, and without those of each model dropped."""
    if products.gram.is_cuda and problem.config.select.method != "stagewise":
        return _errors_together(products, model, dropped, problem)
    kept = [products, *(with_atoms(products, model != each) for each in dropped)]
    return [_error(each, problem) for each in kept]


def _errors_together(
    products: Products, model: Tensor, dropped: list[int], problem: Problem
) -> list[float]:
    """`_errors` on a GPU: every texel chooses as often as there are errors, all at once."""
    model, times = model.to(products.gram.device), 1 + len(dropped)
    kept = torch.stack([torch.ones_like(model).bool(), *(model != each for each in dropped)])
    importance = products.importance
    many = replace(
        products,
        correlation=products.correlation.repeat(times, 1, 1),
        energy=products.energy.repeat(times, 1),
        importance=None if importance is None else importance.repeat(times),
    )
    count = len(products.energy)
    open_ones = closed(many.correlation, kept.repeat_interleave(count, 0))
    config = problem.config
    fit = select(many, Target(open_ones, many.energy), config.select, config.stagewise)
    errors = squared_errors(many, fit)
    if many.importance is not None:
        errors = errors * many.importance
    return errors.view(times, count).sum(1).tolist()


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
