"""Fit a sparse parametric mixture model to a BTF: the paper's algorithm, stage by stage.

`python -m spmm_torch.fit INPUT -o RUN` is the same as `spmm fit INPUT -o RUN`.
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from .checkpoint import Checkpoint, stage_generator
from .config import FitConfig
from .data import BTF, Selection, load_btf
from .data.cache import default_folder
from .device import full_precision, local_device, resolve_device
from .errors import SPMMError
from .evaluate import Likeness, likeness, sphere_section
from .memory import Budget, parse_size
from .metrics import Totals
from .model import SPMM
from .progress import Progress, Stage
from .ranks import Ranks, joined_ranks, local_count, speaks
from .report.summary import headline, summarize, warning_of_failed_starts
from .resources import Resources
from .run_folder import (
    LOG,
    REPORT_PAGE,
    STATE,
    fingerprint,
    is_finished,
    new_run,
    remove_leftovers,
    write_run,
)
from .schema import describe
from .stages.assemble import assemble, warning_of_fewer_clusters
from .stages.cluster import Clusters, cluster_texels, sample_texels
from .stages.dictionary import FoundLobes, build_dictionary
from .stages.grid import DirectionGrid
from .stages.plan import estimate
from .stages.search import search_lobes, search_steps
from .stages.texels import Setting, fit_texels
from .stopwatch import Stopwatch

# Exit code of a command that Ctrl-C has ended, as shells give it.
STOPPED = 130


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
) -> FitResult:
    """Fits a model to a BTF [WDR11 §3.2, §4.1].

    Args:
        btf: measured reflectance.
        config: settings; the defaults are those of `configs/default.yaml`.
        progress: who is told how far it is; nobody by default.
        resources: with what to work.
        render: whether to compare pictures of both, which `mssim` of the report is from.

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
    cache = resources.cache or (None if ranks.size == 1 else default_folder())
    progress.say(plan.describe(budget, cached=cache is not None))
    with torch.no_grad(), full_precision(), watch("total"):
        with watch("load"), progress.stage("load", len(btf.view), "views") as stage:
            btf.load(stage.to, memory=budget.spare, cache=cache)
        with progress.stage("cluster", 2 * btf.texel_count, "texels") as stage:
            clusters = checkpoint.once(
                "cluster", Clusters, lambda: _cluster(btf, config, device, watch, stage, ranks)
            )
        count = len(clusters.members)
        if warning := warning_of_fewer_clusters(count, config.cluster.count, btf.texel_count):
            progress.say(warning)
        samples, owners = sample_texels(
            clusters, config.sample, stage_generator(config.seed, "sample")
        )
        grid = DirectionGrid.build(btf.light, btf.view, device)
        steps = search_steps(config, len(samples))
        with progress.stage("search", steps, "steps") as stage:
            found = checkpoint.once(
                "search",
                FoundLobes,
                lambda: _search(btf, samples, owners, grid, config, watch, stage, ranks),
            )
        with watch("dictionary"):
            dictionary = build_dictionary(found, count, grid, config.dictionary)
        with progress.stage("select", btf.texel_count, "texels") as stage:
            spare = budget.spare - plan.kept_bytes(budget, cached=cache is not None)
            setting = Setting(btf, dictionary, config, watch, spare, ranks)
            fits = fit_texels(setting, clusters.members, checkpoint, stage)
        model = assemble(btf, clusters, dictionary.lobes, fits)
        pictures = None
        if render and ranks.is_first:
            with watch("evaluate"), progress.stage("render"):
                pictures = likeness(model, btf, device)
    totals = Totals.sum(part.totals for part in fits)
    report = summarize(btf, model, totals, watch.seconds, config.seed, device, found.starts)
    if warning := warning_of_failed_starts(found.starts):
        progress.say(warning)
    if pictures is not None:
        report["mssim"] = pictures.mssim
    info = {"labels": clusters.labels, "samples": samples, "lobes_found": len(found.lobes)}
    return FitResult(model, report, info, pictures)


def _cluster(
    btf: BTF,
    config: FitConfig,
    device: torch.device,
    watch: Stopwatch,
    stage: Stage,
    ranks: Ranks,
) -> Clusters:
    generator = stage_generator(config.seed, "cluster")
    with watch("cluster"):
        return cluster_texels(btf, config.cluster, generator, device, stage, ranks)


def _search(
    btf: BTF,
    samples: Tensor,
    owners: Tensor,
    grid: DirectionGrid,
    config: FitConfig,
    watch: Stopwatch,
    stage: Stage,
    ranks: Ranks,
) -> FoundLobes:
    generator = stage_generator(config.seed, "search")
    with watch("search"):
        return ranks.first(
            lambda: search_lobes(btf, samples, owners, grid, config, generator, stage).on_cpu()
        )


def with_lobe_limit(config: FitConfig) -> FitConfig:
    """Settings whose samples have no more lobes than texels may have.

    A lobe found beside others does its best beside them: where texels may have few, samples must
    do with few too.
    """
    limit = config.select.max_lobes
    if limit is None or limit >= config.search.max_lobes or config.search.method == "stagewise":
        return config
    return replace(config, search=replace(config.search, max_lobes=limit))


def main(arguments: list[str] | None = None) -> int:
    """The command `spmm fit`; returns the exit code."""
    options = parser().parse_args(arguments)
    try:
        run = run_fit(options)
    except SPMMError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print(
            "stopped; the same command with --resume goes on from the last finished stage.",
            file=sys.stderr,
        )
        return STOPPED
    if speaks():
        print(f"{run / REPORT_PAGE}")
    return 0


def parser() -> argparse.ArgumentParser:
    """The options of `spmm fit`."""
    rows = "\n".join(
        f"  {key} ({default}): {meaning}" for key, default, meaning in describe(FitConfig)
    )
    result = argparse.ArgumentParser(
        prog="spmm fit",
        description="Fit a sparse parametric mixture model to a BTF. Start it with torchrun to "
        "share the work among processes.",
        epilog=f"settings for --config and --set, with their defaults:\n{rows}",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add = result.add_argument
    add("input", help="zip or folder of pictures (UBO2003, ATRIUM, OpenEXR), UBO2014 .btf, or NPZ")
    add("-o", "--output", required=True, metavar="RUN", help="folder to make")
    add("--config", metavar="YAML", help="settings; default: configs/default.yaml")
    add("--set", action="append", default=[], metavar="KEY=VALUE", help="one setting, repeatable")
    add("--device", help="auto, cpu, cuda or cuda:N")
    add("--seed", type=int, help="seed of every random choice")
    add("--crop", metavar="X0,Y0,W,H", help="fit this rectangle of texels only")
    add("--texels", type=int, metavar="N", help="fit about N texels only, spread over the picture")
    add(
        "--directions",
        metavar="K",
        help="fit every K-th ring of directions; or polar angles such "
        "as 0,30,60; or indices such as 'views=0-8;lights=0,4'",
    )
    add("--resume", action="store_true", help="go on with a run that was stopped")
    add("--no-render", action="store_true", help="no sphere pictures, so no MSSIM; saves seconds")
    add("--max-memory", metavar="SIZE", help="such as 4GB; default: half of what is free")
    add("--cache", metavar="FOLDER", help="keep decoded values here, for later runs too")
    return result


def run_fit(options: argparse.Namespace) -> Path:
    """Fits as the command line asks and leaves a run folder, whole or not at all.

    What a stopped run has finished stays beside it, for `--resume`.
    """
    if options.resume and is_finished(options.output):
        remove_leftovers(options.output)
        return Path(options.output)
    config = FitConfig.from_yaml(options.config) if options.config else FitConfig()
    config = config.override(options.set + _assignments(options))
    config = replace(config, device=local_device(config.device))
    memory = parse_size(options.max_memory) if options.max_memory else None
    cache = Path(options.cache) if options.cache else None
    data = config.data
    btf = load_btf(
        options.input,
        gamma=data.gamma,
        cosine=data.cosine,
        negative=data.negative,
        selection=Selection(data.crop, data.texels, data.directions),
        seed=config.seed,
    )
    with (
        joined_ranks(resolve_device(config.device)) as ranks,
        new_run(options.output, fingerprint(btf, config), options.resume, ranks) as folder,
    ):
        progress = Progress(log=folder / LOG if ranks.is_first else None, enabled=ranks.is_first)
        resources = Resources(memory, cache, folder / STATE, ranks)
        result = fit(btf, config, progress, resources, not options.no_render)
        if ranks.is_first:
            sections = [] if result.likeness is None else [sphere_section(result.likeness)]
            write_run(folder, result.model, result.report, config, btf, sections)
            progress.say(headline(result.report))
    return Path(options.output)


def _assignments(options: argparse.Namespace) -> list[str]:
    """Settings that have an option of their own."""
    given = {
        "device": options.device,
        "seed": options.seed,
        "data.crop": f"[{options.crop}]" if options.crop else None,
        "data.texels": options.texels,
        "data.directions": f"'{options.directions}'" if options.directions else None,
    }
    return [f"{key}={value}" for key, value in given.items() if value is not None]


if __name__ == "__main__":
    sys.exit(main())
