"""The fit of scattered samples: lobes, weights of each texel, and their storage.

Lobes are found on some texels, each on its own pairs, and all texels choose from all of them, each
by its own pairs. There is no residual and no relief: both live on a grid of lights and views.
"""

from __future__ import annotations

import torch

from ...config.fit import FitConfig, WeightsConfig
from ...data.error_weights import UNIFORM, Weights
from ...data.scattered_btf import ScatteredBTF
from ...data.units import unit_of
from ...errors import ConfigError
from ...evaluate.sample_errors import sample_errors
from ...lobes.batch import LobeBatch
from ...metrics import Totals, snr_db
from ...model.lookup import SparseWeights
from ...model.residual import Residual
from ...model.spmm import SPMM
from ...model.stored_weights import WEIGHT_TYPES, rounded
from ...report.wording import plural
from ...runtime.context import Context
from ...solvers.status import StatusCounts
from ..glossy.objective import Objective
from ..load import keyed
from ..mixtures import Mixtures
from ..refit.system import FAINT, MAX_ROUNDING_DB
from ..solved import Solved
from .listed import ListFit
from .search import Task, distinct_lobes, found_lobes, search_tasks
from .select import fit_lists


def fit_samples(
    btf: ScatteredBTF, config: FitConfig, context: Context, weights: Weights | None
) -> Solved:
    """Fits a model to scattered samples.

    Args:
        btf: the input, in its own unit.
        config: of the fit.
        context: of the run.
        weights: those that were given; None or uniform, as others need a grid.

    Raises:
        ConfigError: a setting or the weights need a grid, or several processes share the run.
        DataError: values are not valid.
    """
    _check(config, context, weights)
    context = keyed(context, btf, config, UNIFORM)
    with context.watch("load"):
        btf.load()
        unit = unit_of(btf)
        near = btf.scaled(unit)
        objective = Objective.of_lists(config)
    for line in (*btf.notes, described(btf)):
        context.progress.say(line)
    tasks = search_tasks(near, config, context, objective)
    found = found_lobes(tasks, context)
    lobes = distinct_lobes(found, tasks, context)
    fits = _fits(near, lobes, tasks[0], context)
    with context.watch("refit"):
        model, totals = _stored(btf, _mixtures(lobes, fits, btf.texel_count, unit), config)
    own = [fit.solvers for fit in fits]
    compressed = not objective.plain
    return Solved(
        model,
        totals,
        Totals.sum(fit.weighted for fit in fits).times(unit**-2) if compressed else None,
        (objective,),
        found.starts,
        StatusCounts.sum([*(task.samples.solvers for task in tasks), found.solvers, *own]),
        torch.cat([task.pairs.texels[task.samples.texels] for task in tasks]),
        len(found.lobes),
    )


def described(btf: ScatteredBTF) -> str:
    """What the log says of scattered samples."""
    lists, pairs = len(btf.lists), sum(len(part.wi) for part in btf.lists)
    shared = f"{plural(lists, 'list')} of {plural(pairs, 'pair')} of directions in all"
    return (
        f"scattered samples: {plural(btf.texel_count, 'texel')}, {shared}; without a grid there is "
        f"neither a residual nor a relief"
    )


def _check(config: FitConfig, context: Context, weights: Weights | None) -> None:
    """Refuses settings and weights that need a grid."""
    given = WeightsConfig(error=config.weights.error, floor=config.weights.floor)
    needs = {
        "weights.scene and weights.file": config.weights != given,
        "auto": config.auto,
        "relief.height": config.relief.height is not None,
    }
    for name, asked in needs.items():
        if asked:
            raise ConfigError(
                f"{name} of the settings needs a grid of lights and views, and the input holds "
                f"scattered samples; expected it unset; leave it out."
            )
    if weights is not None and not weights.uniform:
        raise ConfigError(
            "weights of errors were given to a fit of scattered samples; expected None, as they "
            "need a grid of lights and views; leave them out."
        )
    if context.ranks.size > 1:
        raise ConfigError(
            f"{context.ranks.size} processes share this fit, whose input holds scattered samples; "
            f"expected one process; start it without torchrun."
        )


def _fits(btf: ScatteredBTF, lobes: LobeBatch, task: Task, context: Context) -> list[ListFit]:
    """The fits of all texels."""
    fits = []
    stage = context.progress.stage("select", btf.texel_count, "texels")
    with stage as advance, context.watch("select"):
        for fit in fit_lists(btf.lists, lobes, task.problem):
            fits.append(fit)
            advance(len(fit.texels))
    return fits


def _mixtures(lobes: LobeBatch, fits: list[ListFit], count: int, unit: float) -> Mixtures:
    """The lobes in use, and the entries of all texels in the unit of the input."""
    texels, index, weight = [], [], []
    for fit in fits:
        real = fit.index >= 0  # [n, M]
        texels.append(fit.texels[:, None].expand(real.shape)[real])
        index.append(fit.index[real])
        weight.append(fit.weights[real])
    texel = torch.cat(texels)
    order = torch.argsort(texel, stable=True)
    number = torch.bincount(texel, minlength=count)
    offset = torch.cat((number.new_zeros(1), number.cumsum(0)))
    used, place = torch.unique(torch.cat(index)[order], return_inverse=True)
    entries = SparseWeights(offset, place, torch.cat(weight)[order] / unit)
    return Mixtures(lobes.to("cpu").detach()[used], entries)


def _stored(btf: ScatteredBTF, found: Mixtures, config: FitConfig) -> tuple[SPMM, Totals]:
    """The model with weights as stored, and its squared errors.

    The number format is that of `storage.weights`; `auto`: the first that costs little.
    """
    asked = config.storage.weights
    if asked != "auto":
        return _model(btf, found, WEIGHT_TYPES[asked])
    exact = _model(btf, found, torch.float32)
    energy, error = exact[1].energy, exact[1].with_residual
    if error < FAINT * energy:
        return exact
    for kind in ("byte", "int16"):
        model, totals = _model(btf, found, WEIGHT_TYPES[kind])
        if snr_db(energy, error) - snr_db(energy, totals.with_residual) <= MAX_ROUNDING_DB:
            return model, totals
    return exact


def _model(btf: ScatteredBTF, found: Mixtures, kind: torch.dtype) -> tuple[SPMM, Totals]:
    """The model with weights of a number format, and its squared errors."""
    empty = torch.zeros(0, len(btf.view), len(btf.light), btf.channels, dtype=torch.float16)
    model = SPMM(
        btf.height,
        btf.width,
        found.lobes,
        rounded(found.entries, kind),
        torch.zeros(btf.texel_count, dtype=torch.long),
        Residual(empty, torch.zeros(0), btf.light, btf.view),
        btf.light,
        btf.view,
        btf.name,
        weight_type=kind,
    )
    return model, sample_errors(model, btf).totals()
