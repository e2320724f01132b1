"""Stage load: decoded values, weights of errors, and the memory that they may take."""

from __future__ import annotations

from dataclasses import dataclass, replace

import torch
from torch import Tensor

from ..config.fit import FitConfig
from ..data import BTF
from ..data.cache import default_folder
from ..data.error_weights import Weights
from ..data.units import scaled, unit_of
from ..runs.fingerprint import fingerprint, key_of
from ..runtime.context import Context
from .glossy.kinds import has_kinds, kinds
from .glossy.objective import Objective
from .glossy.trial import STEPS
from .plan import estimate
from .problem import Problem
from .weighting import compression, given_weights


@dataclass(frozen=True)
class Loaded:
    """The input of a fit, decoded.

    Attributes:
        btf: in a unit in which it can be computed with.
        weights: of the errors, as the user gave them.
        context: of the run, with the memory that is left.
        unit: power of two by which the values of the input were multiplied.
    """

    btf: BTF
    weights: Weights
    context: Context
    unit: float


def load(btf: BTF, config: FitConfig, context: Context, weights: Weights | None) -> Loaded:
    """Decodes the input.

    Args:
        btf: the input.
        config: of the fit.
        context: of the run.
        weights: of the errors; None: those of the settings.

    Raises:
        DataError: the BTF cannot be decoded, is not valid, or holds a hot pixel.
        ConfigError: the memory limit is too low.
    """
    weights = given_weights(btf, config.weights) if weights is None else weights
    context = keyed(context, btf, config, weights)
    plan = estimate(btf, config, context.device)
    budget = context.budget.needing(plan.working_bytes)
    cache = context.cache or (None if context.ranks.size == 1 else default_folder())
    cached = cache is not None
    for note in btf.notes:
        context.progress.say(note)
    context.progress.say(plan.describe(budget, cached))
    with context.watch("load"), context.progress.stage("load", len(btf.view), "views") as stage:
        btf.load(stage.to, memory=budget.spare, cache=cache)
    kept = plan.kept_bytes(budget, cached)
    context = replace(context, budget=replace(budget, kept=kept), cache=cache)
    unit = unit_of(btf)
    return Loaded(scaled(btf, unit), weights, context, unit)


def posed(loaded: Loaded, config: FitConfig, suited: str | None = None) -> Problem:
    """The problem that the other stages solve, by the errors that are `suited`, where they count.

    See `Objective.of`.
    """
    btf, context = loaded.btf, loaded.context
    with context.watch("objective"):
        objective = Objective.of(btf, config, context.device, suited)
    if told := objective.describe():
        context.progress.say(told)
    compressed = compression(btf, objective, context.device, context.ranks)
    weights = loaded.weights
    if compressed is not None:
        weights = weights.times(compressed.weights(btf))
    return Problem.build(btf, weights, config, context, objective, loaded.unit, compressed)


def posed_apart(loaded: Loaded, config: FitConfig) -> list[tuple[Tensor, Problem]]:
    """Problems of unrelated materials by kind, with their texels `[n]`; one of a texture.

    Those of several keep no finished stages.
    """
    btf, context = loaded.btf, loaded.context
    every = torch.arange(btf.texel_count)
    if not has_kinds(btf, config) or not loaded.weights.uniform_but_for(btf.measured):
        return [(every, posed(loaded, config))]
    stage = context.progress.stage("objective", STEPS * btf.texel_count, "steps")
    with context.watch("objective"), stage as advance:
        parts = kinds(btf, config, context.device, advance)
    if len(parts) == 1:
        return [(every, posed(loaded, config, parts[0].suited))]
    told = ", ".join(f"{len(part.texels)} {part.name}" for part in parts)
    context.progress.say(f"materials of one kind are fit together: {told}")
    context = replace(context, state=None)
    problems = []
    for part in parts:
        own = part.part(btf)
        one = replace(loaded, btf=own, weights=Weights.build(own), context=context)
        problems.append((part.texels, posed(one, config, part.suited)))
    return problems


def keyed(context: Context, btf: BTF, config: FitConfig, weights: Weights) -> Context:
    """The context whose finished stages, if it keeps any, depend on the input and the settings.

    Raises:
        DataError: the input cannot be read any more.
    """
    if context.state is None or context.depends_on:
        return context
    facts = context.ranks.first(lambda: fingerprint(btf, config, weights))
    return replace(context, depends_on=key_of(facts))
