"""Fit a sparse parametric mixture model to a BTF: the paper's algorithm, stage by stage."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import torch
from torch import Tensor

from ..config.fit import FitConfig
from ..data import BTF
from ..data.cache import default_folder
from ..data.error_weights import Weights
from ..evaluate import Likeness, likeness
from ..lobes.grid import DirectionGrid
from ..metrics import Totals
from ..model.spmm import SPMM
from ..report.summary import summarize, warning_of_failed_starts
from ..runtime.checkpoint import Checkpoint, stage_generator
from ..runtime.context import Resources
from ..runtime.device import full_precision, resolve_device
from ..runtime.memory import Budget
from ..runtime.progress import Progress
from ..runtime.ranks import local_count
from ..runtime.stopwatch import Stopwatch
from .assemble import assemble, warning_of_fewer_clusters
from .cluster import Clusters, sample_texels
from .dictionary import FoundLobes, build_dictionary
from .plan import estimate
from .prune.auto import Choice, auto_texels
from .residual.missing import MissingPairs
from .search.lobes import search_steps
from .select.clusters import Setting, fit_texels
from .steps import Steps
from .weighting import compressive_weights, given_weights


@dataclass(frozen=True)
class FitResult:
    """What a fit yields.

    Attributes:
        model: the mixture model, on the CPU.
        report: the figures of `report.json`.
        info: `labels [T]`, `samples [S]` and the number of `lobes_found`.
        likeness: the sphere pictures and their MSSIM; None where they were not asked for.
    """

    model: SPMM
    report: dict[str, Any]
    info: dict[str, Any]
    likeness: Likeness | None = None


def fit(
    btf: BTF,
    config: FitConfig | None = None,
    progress: Progress | None = None,
    resources: Resources | None = None,
    render: bool = True,
    weights: Weights | None = None,
) -> FitResult:
    """Fits a model to a BTF [WDR11 §3.2, §4.1].

    Args:
        btf: measured reflectance.
        config: settings; the defaults are those of `configs/default.yaml`.
        progress: who is told how far it is; nobody by default.
        resources: with what to work.
        render: whether to compare pictures of both, which `mssim` of the report is from.
        weights: how much errors count; None: as the settings say.

    Raises:
        DataError: the BTF cannot be decoded or is not valid.
        ConfigError: a setting cannot be met here, such as a missing device.
        OutputError: the disk is full.
    """
    config = with_lobe_limit(config or FitConfig())
    progress = progress or Progress(enabled=False)
    resources = resources or Resources()
    ranks = resources.ranks
    device = resolve_device(config.device)
    watch = resources.watch or Stopwatch(device)
    checkpoint = Checkpoint(watch, resources.state, ranks)
    plan = estimate(btf, config, device)
    budget = Budget.build(resources.memory, plan.working_bytes, local_count())
    weights = given_weights(btf, config.weights) if weights is None else weights
    cache = resources.cache or (None if ranks.size == 1 else default_folder())
    progress.say(plan.describe(budget, cached=cache is not None))
    with torch.no_grad(), full_precision(), watch("total"):
        with watch("load"), progress.stage("load", len(btf.view), "views") as stage:
            btf.load(stage.to, memory=budget.spare, cache=cache)
        weights = weights.times(compressive_weights(btf, config.weights.error, device, ranks))
        steps = Steps(btf, config, weights, device, watch, ranks)
        with progress.stage("cluster", 2 * btf.texel_count, "texels") as stage:
            clusters = checkpoint.once("cluster", Clusters, lambda: steps.cluster(stage))
        count = len(clusters.members)
        if warning := warning_of_fewer_clusters(count, config.cluster.count, btf.texel_count):
            progress.say(warning)
        samples, owners = sample_texels(
            clusters, config.sample, stage_generator(config.seed, "sample"), weights
        )
        steps, choice = _chosen(steps, samples, checkpoint, progress)
        config = steps.config
        grid = DirectionGrid.build(btf.light, btf.view, device, weights.scale(device))
        with progress.stage("search", search_steps(config, len(samples)), "steps") as stage:
            found = checkpoint.once(
                "search", FoundLobes, lambda: steps.search(samples, owners, grid, stage)
            )
        with watch("dictionary"):
            dictionary = build_dictionary(found, count, grid, config.dictionary)
        with progress.stage("select", btf.texel_count, "texels") as stage:
            spare = budget.spare - plan.kept_bytes(budget, cached=cache is not None)
            gaps = MissingPairs.of(btf.measured, btf.light, btf.view)
            setting = Setting(
                btf, clusters.points, dictionary, config, watch, spare, ranks, weights, gaps
            )
            fits = fit_texels(setting, clusters.members, checkpoint, stage)
        model = assemble(btf, clusters, dictionary.lobes, fits)
        worth = steps.worth(clusters, dictionary)
        pictures = None
        if render and ranks.is_first:
            with watch("evaluate"), progress.stage("render"):
                pictures = likeness(model, btf, device)
    totals = Totals.sum(part.totals for part in fits)
    weighted = [part.weighted for part in fits if part.weighted is not None]
    report = summarize(btf, model, totals, watch.seconds, config.seed, device, found.starts)
    if warning := warning_of_failed_starts(found.starts):
        progress.say(warning)
    if pictures is not None:
        report["mssim"] = pictures.mssim
    report["weighted_snr_db"] = Totals.sum(weighted).snr_db() if weighted else None
    report["error_without_model"] = worth
    report["auto"] = choice.report() if choice else None
    info = {"labels": clusters.labels, "samples": samples, "lobes_found": len(found.lobes)}
    return FitResult(model, report, info, pictures)


def _chosen(
    steps: Steps, samples: Tensor, checkpoint: Checkpoint, progress: Progress
) -> tuple[Steps, Choice | None]:
    """The steps with what pays only, if the settings want that."""
    if not steps.config.auto:
        return steps, None
    total = search_steps(steps.config, auto_texels(len(samples)))
    with progress.stage("auto", total, "steps") as stage:
        choice = checkpoint.once("auto", Choice, lambda: steps.choose(samples, stage))
    progress.say(choice.describe(steps.config))
    return replace(steps, config=choice.applied(steps.config)), choice


def with_lobe_limit(config: FitConfig) -> FitConfig:
    """Settings whose samples have no more lobes than texels may have.

    A lobe found beside others does its best beside them: where texels may have few, samples must
    do with few too.
    """
    limit = config.select.max_lobes
    if limit is None or limit >= config.search.max_lobes or config.search.method == "stagewise":
        return config
    return replace(config, search=replace(config.search, max_lobes=limit))
