"""Choice of BRDF models and of `select.min_gain` by the error on held-out directions.

Lobes are searched and chosen on some texels without the held-out views and lights. The cost of a
texel is ln(error on held-out pairs) + g (its lobes + its part of the dictionary), both counted in
bytes of one lobe, where g is `select.min_gain` of the settings: a lobe is worth the fraction g of
the error. First `min_gain` is raised, then models are dropped one by one, while the mean cost does
not rise.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import torch
from torch import Tensor

from ...brdf import MAX_PARAMETERS, MODEL_NAMES
from ...config.fit import FitConfig
from ...data import BTF
from ...data.error_weights import Weights
from ...errors import DataError
from ...runtime.progress import Advance
from ..cluster import Samples
from ..dictionary import Dictionary, merge_lobes
from ..problem import Problem
from ..search.lobes import find_lobes, search_steps
from ..select.products import Products, cluster_products
from ..select.texels import squared_errors
from .ablation import selected, with_atoms

# Texels on which lobes are searched and judged.
AUTO_TEXELS = 64
# Fraction of the views and of the lights that is held out, and the least number of directions.
HELD_OUT, LEAST_DIRECTIONS = 0.1, 4
# Least relative error that counts (40 dB): that of 8-bit codes.
VISIBLE = 1e-4
# Largest value of min_gain that is tried: texels then have one nearly perfect lobe, or none.
MOST_GAIN = 0.9
# Stored bytes of a weight by `storage.weights`; of the index of an entry; and of model, parameters,
# normal and angle of a lobe.
WEIGHT_BYTES = {"auto": 1, "byte": 1, "int16": 2, "float32": 4}
INDEX_BYTES, LOBE_BYTES = 1, 1 + 4 * (MAX_PARAMETERS + 4)


@dataclass(frozen=True)
class Choice:
    """The models and the `min_gain` of least cost.

    Attributes:
        models: indices into `MODEL_NAMES`, `[M]`.
        min_gain: for `select.min_gain`, `[]` float64.
    """

    models: Tensor
    min_gain: Tensor

    def to_tensors(self) -> dict[str, Tensor]:
        """Tensors for a checkpoint: `models [M]` and `min_gain []`."""
        return {"models": self.models, "min_gain": self.min_gain}

    @classmethod
    def from_tensors(cls, tensors: dict[str, Tensor]) -> Choice:
        """The choice of a checkpoint; see `Choice.to_tensors`."""
        return cls(**tensors)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the models."""
        return tuple(MODEL_NAMES[index] for index in self.models.tolist())

    def report(self) -> dict[str, Any]:
        """The entry `auto` of `report.json`."""
        return {"models": list(self.names), "min_gain": float(self.min_gain)}

    def describe(self, given: FitConfig) -> str:
        """One line for the log, given the settings before the choice."""
        dropped = [name for name in given.search.models if name not in self.names]
        return (
            f"auto: select.min_gain {given.select.min_gain:g} -> {float(self.min_gain):g}, "
            f"models dropped: {', '.join(dropped) or 'none'}"
        )

    def applied(self, config: FitConfig) -> FitConfig:
        """The settings with this choice."""
        return replace(
            config,
            search=replace(config.search, models=self.names),
            select=replace(config.select, min_gain=float(self.min_gain)),
        )


def choose_models(problem: Problem, samples: Samples) -> tuple[Problem, Choice | None]:
    """The problem with models and `min_gain` chosen, if its settings ask for that.

    Raises:
        DataError: there are too few directions to hold some out.
    """
    context, config = problem.context, problem.config
    if not config.auto:
        return problem, None

    def work(advance: Advance) -> Choice:
        generator = context.generator("auto")
        return context.ranks.first(lambda: choose(problem, samples, generator, advance))

    steps = search_steps(config, auto_texels(len(samples)))
    choice = context.stage("auto", Choice, work, steps, "steps", timed="search")
    context.progress.say(choice.describe(config))
    return replace(problem, config=choice.applied(config)), choice


def choose(
    problem: Problem, samples: Samples, generator: torch.Generator, advance: Advance
) -> Choice:
    """The models and the `min_gain` of least cost on held-out directions.

    Args:
        problem: the fit.
        samples: S texels, some of which are used.
        generator: draws texels and held-out directions.
        advance: receives the steps of the search on `auto_texels(S)` samples.

    Raises:
        DataError: there are too few directions to hold some out.
    """
    btf, count = problem.btf, auto_texels(len(samples))
    own = samples.texels[torch.randperm(len(samples), generator=generator)[:count]]
    held = held_out(btf, generator)  # [V, L]
    seen, unseen = (
        replace(problem, weights=problem.weights.times(Weights.build(btf, pairs.float())))
        for pairs in (~held, held)
    )
    together = Samples(own, torch.zeros(len(own), dtype=torch.long))
    found = find_lobes(seen, together, generator, advance)
    dictionary = merge_lobes(found, 1, seen.grid(), problem.config.dictionary)
    atoms = unseen.grid().scaled(dictionary.raw)
    return _Trial(
        problem.config,
        dictionary,
        _products(seen, own, dictionary.atoms),
        _products(unseen, own, atoms),
        btf.texel_count,
    ).best()


def auto_texels(samples: int) -> int:
    """How many of the samples are used."""
    return min(samples, AUTO_TEXELS)


def held_out(btf: BTF, generator: torch.Generator) -> Tensor:
    """True `[V, L]` for pairs whose view or light is held out.

    Raises:
        DataError: there are too few directions.
    """
    parts = []
    for count in (len(btf.view), len(btf.light)):
        chosen = torch.zeros(count, dtype=torch.bool)
        if count >= LEAST_DIRECTIONS:
            number = max(1, round(HELD_OUT * count))
            chosen[torch.randperm(count, generator=generator)[:number]] = True
        parts.append(chosen)
    view, light = parts
    if not bool(view.any() or light.any()):
        raise DataError(
            f"{btf.name} has {len(view)} views and {len(light)} lights; auto expected at least "
            f"{LEAST_DIRECTIONS} of either to hold some out; fit without it."
        )
    return view[:, None] | light


def _products(problem: Problem, texels: Tensor, atoms: Tensor) -> Products:
    """Products of `texels [n]` with `atoms [J, D]`."""
    return cluster_products(
        lambda part: problem.signals(texels[part]),
        [slice(0, len(texels))],
        (len(texels), problem.btf.channels),
        atoms,
    )


@dataclass(frozen=True)
class _Trial:
    """Texels and a dictionary that was found without the held-out pairs.

    Attributes:
        config: of the fit.
        dictionary: of the lobes found.
        seen, unseen: products of the texels with all atoms, on the other and on the held-out pairs.
        texel_count: T of the whole BTF.
    """

    config: FitConfig
    dictionary: Dictionary
    seen: Products
    unseen: Products
    texel_count: int

    @cached_property
    def _model(self) -> Tensor:
        """Model of each lobe, `[J]`."""
        return self.dictionary.lobes.model

    def best(self) -> Choice:
        """Raises min_gain, then drops models, while the cost does not rise."""
        models, best = torch.unique(self._model), self.config.select.min_gain
        least, gain = self.cost(models, best), best
        while 0.0 < gain < MOST_GAIN:
            gain = min(2.0 * gain, MOST_GAIN)
            cost = self.cost(models, gain)
            if cost <= least:
                least, best = cost, gain
        while len(models) > 1:
            rest = [models[models != index] for index in models.tolist()]
            costs = [self.cost(kept, best) for kept in rest]
            lowest = min(range(len(rest)), key=costs.__getitem__)
            if costs[lowest] > least:
                break
            models, least = rest[lowest], costs[lowest]
        return Choice(models, torch.tensor(best, dtype=torch.float64))

    def cost(self, models: Tensor, min_gain: float) -> float:
        """Mean cost of the texels, as defined above, with lobes of `models [M]` only."""
        kept = torch.isin(self._model, models)
        select = replace(self.config.select, min_gain=min_gain)
        fit = selected(with_atoms(self.seen, kept), replace(self.config, select=select))
        unseen = with_atoms(self.unseen, kept)
        energy = unseen.energy.sum(1)  # [n]
        ratio = squared_errors(unseen, fit) / energy.clamp(min=torch.finfo(energy.dtype).tiny)
        error = float(ratio.clamp(min=VISIBLE).log().mean())
        weight = WEIGHT_BYTES[self.config.storage.weights]
        entry = INDEX_BYTES + weight * unseen.energy.shape[1]
        used = fit.index[fit.index >= 0]
        lobes = len(used) / len(energy)
        own_dictionary = len(torch.unique(used)) * LOBE_BYTES / entry / self.texel_count
        price = self.config.select.min_gain
        return error + price * (lobes + own_dictionary) if math.isfinite(error) else math.inf
