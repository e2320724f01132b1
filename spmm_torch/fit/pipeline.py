"""Fit a sparse parametric mixture model to a BTF: the paper's algorithm, stage by stage."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import torch

from ..config.fit import FitConfig
from ..data import BTF, obeying
from ..data.error_weights import Weights
from ..data.scattered_btf import ScatteredBTF
from ..evaluate import Looks, looks
from ..model.spmm import SPMM
from ..report.contract import Report
from ..report.summary import (
    summarize,
    warning_of_failed_starts,
    warning_of_narrow_lobes,
)
from ..runtime.context import Context
from ..runtime.device import full_precision, plain_torch
from ..solvers.status import StatusCounts
from .align import align
from .assemble import assemble
from .cluster import cluster_texels, sample_texels
from .dictionary import build_dictionary
from .load import load, posed_apart
from .mixtures import mix
from .problem import Problem
from .prune.ablation import ablate
from .prune.auto import choose_models
from .refit.stage import refit_pictures
from .scattered.stage import fit_samples
from .search.lobes import search_lobes
from .select.together import fit_clusters
from .solved import Solved, joined


@dataclass(frozen=True)
class FitResult:
    """The model of a fit and its report.

    Attributes:
        model: the mixture model, on the CPU.
        figures: errors, sizes and times.
        info: `labels [T]`, `samples [S]` and the number of `lobes_found`.
        looks: pictures and their scores; None if they were not asked for, or texels are no
            neighbours.
    """

    model: SPMM
    figures: Report
    info: dict[str, Any]
    looks: Looks | None = None

    @property
    def report(self) -> dict[str, Any]:
        """The figures by the keys of `report.json`."""
        return self.figures.to_dict()


@plain_torch()
def fit(
    btf: BTF,
    config: FitConfig | None = None,
    context: Context | None = None,
    *,
    weights: Weights | None = None,
    render: bool = True,
) -> FitResult:
    """Fits a model to a BTF [WDR11 §3.2, §4.1].

    Args:
        btf: measured reflectance; `config.data` is obeyed however it was opened.
        config: settings; the defaults are those of `configs/default.yaml`.
        context: of the run; None: device and seed of the settings, without messages.
        weights: of the errors; None: those of the settings.
        render: whether to make pictures of both, for `mssim`, `sharpness` and `display` of the
            report.

    Raises:
        DataError: the BTF cannot be decoded or is not valid.
        ConfigError: a setting cannot be met here, such as a missing device.
        OutputError: the disk is full.
    """
    config = with_lobe_limit(config or FitConfig())
    context = context or Context.build(config.device, config.seed)
    btf = obeying(btf, config.data, config.seed)
    with torch.no_grad(), full_precision(), context.watch("total"):
        if isinstance(btf, ScatteredBTF):
            solved, pictures = fit_samples(btf, config, context, weights), None
        else:
            solved = _fit_grid(btf, config, context, weights)
            has_pictures = render and btf.names is None
            pictures = _pictures(solved.model, btf, context) if has_pictures else None
    objective = solved.objective()
    for warning in (warning_of_failed_starts(solved.starts), warning_of_narrow_lobes(objective)):
        if warning:
            context.progress.say(warning)
    figures = summarize(
        btf,
        solved.model,
        context,
        totals=solved.totals,
        weighted=solved.weighted,
        objective=objective,
        starts=solved.starts,
        solvers=solved.solvers,
        ablation=solved.ablation,
        auto=solved.auto,
        mssim=pictures.likeness.mssim if pictures else None,
        sharpness=pictures.slices.sharpness if pictures else None,
        display=pictures.slices.display if pictures else None,
    )
    info = {
        "labels": solved.model.labels,
        "samples": solved.samples,
        "lobes_found": solved.lobes_found,
    }
    return FitResult(solved.model, figures, info, pictures)


def _fit_grid(btf: BTF, config: FitConfig, context: Context, weights: Weights | None) -> Solved:
    """The fit of a BTF; unrelated materials are fit kind by kind."""
    parts = posed_apart(load(btf, config, context, weights), config)
    solved = [_solve(problem) for _, problem in parts]
    if len(parts) == 1:
        return solved[0]
    return joined(solved, [texels for texels, _ in parts], btf)


def _solve(problem: Problem) -> Solved:
    """All stages between the values and the model."""
    problem = align(problem)
    clusters = cluster_texels(problem)  # §4.1, k-means
    samples = sample_texels(problem, clusters)  # §4.1, stratified
    problem, choice = choose_models(problem, samples)
    found = search_lobes(problem, samples)  # §3.2, Eq. 5
    dictionary = build_dictionary(problem, found, len(clusters.members))  # §4.1
    fits = fit_clusters(problem, clusters, dictionary)  # §3.2, stagewise Lasso; §4.1, residual
    mixtures = mix(clusters, dictionary, fits)
    refit = refit_pictures(problem, clusters, mixtures, fits)
    return Solved(
        model=assemble(problem, clusters, mixtures, refit),  # Eq. 2
        totals=refit.totals.times(problem.unit**-2),
        weighted=refit.weighted and refit.weighted.times(problem.unit**-2),
        objectives=(problem.objective,),
        starts=found.starts,
        solvers=StatusCounts.sum(part.solvers for part in (clusters, samples, found, *fits, refit)),
        samples=samples.texels,
        lobes_found=len(found.lobes),
        ablation=ablate(problem, clusters.labels, dictionary),
        auto=choice.report() if choice else None,
    )


def _pictures(model: SPMM, btf: BTF, context: Context) -> Looks | None:
    """Pictures of model and BTF; None but on the first rank."""
    if not context.ranks.is_first:
        return None
    with context.watch("evaluate"), context.progress.stage("render"):
        return looks(model, btf, context.device, context.budget.left())


def with_lobe_limit(config: FitConfig) -> FitConfig:
    """Settings whose samples have at most as many lobes as texels may have.

    The lobes of a sample are refined together and serve best together: where texels may have few,
    samples must have few.
    """
    limit = config.select.max_lobes
    if limit is None or limit >= config.search.max_lobes or config.search.method == "stagewise":
        return config
    return replace(config, search=replace(config.search, max_lobes=limit))
