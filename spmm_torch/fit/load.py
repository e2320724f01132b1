"""Stage load: decoded values, weights of errors, and the memory that they may take."""

from __future__ import annotations

from dataclasses import replace

from ..config.fit import FitConfig
from ..data import BTF
from ..data.cache import default_folder
from ..data.error_weights import Weights
from ..data.units import scaled, unit_of
from ..runs.fingerprint import fingerprint, key_of
from ..runtime.context import Context
from .glossy.objective import Objective
from .plan import estimate
from .problem import Problem
from .weighting import compressive_weights, given_weights


def load(btf: BTF, config: FitConfig, context: Context, weights: Weights | None) -> Problem:
    """The problem that the other stages solve.

    Args:
        btf: the input, which is decoded here.
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
    btf = scaled(btf, unit)
    objective = Objective.of(btf, config, context.device)
    if told := objective.describe():
        context.progress.say(told)
    compressive = compressive_weights(btf, objective, context.device, context.ranks)
    return Problem.build(btf, weights.times(compressive), config, context, objective, unit)


def keyed(context: Context, btf: BTF, config: FitConfig, weights: Weights) -> Context:
    """The context whose finished stages, if it keeps any, depend on the input and the settings.

    Raises:
        DataError: the input cannot be read any more.
    """
    if context.state is None or context.depends_on:
        return context
    facts = context.ranks.first(lambda: fingerprint(btf, config, weights))
    return replace(context, depends_on=key_of(facts))
