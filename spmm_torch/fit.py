"""Fit a sparse parametric mixture model to a BTF: the paper's algorithm, stage by stage.

`python -m spmm_torch.fit INPUT -o RUN` is the same as `spmm fit INPUT -o RUN`.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import torch

from .config import FitConfig
from .data import BTF, load_btf
from .errors import ConfigError, SPMMError
from .metrics import Totals
from .model import SPMM
from .progress import Progress
from .report.summary import headline, summarize
from .run_folder import LOG, REPORT_PAGE, new_run, write_run
from .schema import describe
from .stages.assemble import assemble, warning_of_fewer_clusters
from .stages.cluster import cluster_texels, sample_texels
from .stages.dictionary import build_dictionary
from .stages.grid import DirectionGrid
from .stages.search import search_lobes, search_steps
from .stages.texels import fit_texels
from .stopwatch import Stopwatch


@dataclass(frozen=True)
class FitResult:
    """What a fit yields.

    Attributes:
        model: the mixture model, on the CPU.
        report: the figures of `report.json`.
        info: `labels [T]`, `samples [S]` and the number of `lobes_found`.
    """

    model: SPMM
    report: dict[str, Any]
    info: dict[str, Any]


def fit(btf: BTF, config: FitConfig | None = None, progress: Progress | None = None) -> FitResult:
    """Fits a model to a BTF [WDR11 §3.2, §4.1].

    Args:
        btf: measured reflectance.
        config: settings; the defaults are those of `configs/default.yaml`.
        progress: who is told how far it is; nobody by default.

    Raises:
        DataError: the BTF cannot be decoded or is not valid.
        ConfigError: a setting cannot be met here, such as a missing device.
    """
    config = with_lobe_limit(config or FitConfig())
    progress = progress or Progress(enabled=False)
    device = resolve_device(config.device)
    generator = torch.Generator().manual_seed(config.seed)
    watch = Stopwatch(device)
    with torch.no_grad(), full_precision(), watch("total"):
        with watch("load"), progress.stage("load", len(btf.view), "views") as stage:
            btf.load(stage.to)
        with watch("cluster"), progress.stage("cluster", 2 * btf.texel_count, "texels") as stage:
            clusters = cluster_texels(btf, config.cluster, generator, device, stage)
            samples, owners = sample_texels(clusters, config.sample, generator)
        count = len(clusters.members)
        if warning := warning_of_fewer_clusters(count, config.cluster.count, btf.texel_count):
            progress.say(warning)
        grid = DirectionGrid.build(btf.light, btf.view, device)
        steps = search_steps(config, len(samples))
        with watch("search"), progress.stage("search", steps, "steps") as stage:
            found = search_lobes(btf, samples, owners, grid, config, generator, stage)
        with watch("dictionary"):
            dictionary = build_dictionary(found, count, grid, config.dictionary)
        with progress.stage("select", btf.texel_count, "texels") as stage:
            fits = fit_texels(btf, clusters.members, dictionary, config, watch, stage)
        model = assemble(btf, clusters, dictionary.lobes, fits)
    totals = Totals.sum(part.totals for part in fits)
    report = summarize(btf, model, totals, watch.seconds, config.seed, device)
    info = {"labels": clusters.labels, "samples": samples, "lobes_found": len(found.lobes)}
    return FitResult(model, report, info)


def with_lobe_limit(config: FitConfig) -> FitConfig:
    """Settings whose samples have no more lobes than texels may have.

    A lobe found beside others does its best beside them: where texels may have few, samples must
    do with few too.
    """
    limit = config.select.max_lobes
    if limit is None or limit >= config.search.max_lobes or config.search.method == "stagewise":
        return config
    return replace(config, search=replace(config.search, max_lobes=limit))


def resolve_device(name: str) -> torch.device:
    """The device of a setting: `auto` is the GPU where there is one.

    Raises:
        ConfigError: no such device here.
    """
    if name == "auto":
        return torch.device("cuda" if torch.cuda.is_available() else "cpu")
    try:
        device = torch.device(name)
    except RuntimeError as error:
        raise ConfigError(f"device is {name!r}; expected auto, cpu, cuda or cuda:N.") from error
    if device.type not in ("cpu", "cuda"):
        raise ConfigError(f"device is {name!r}; expected auto, cpu, cuda or cuda:N.")
    count = torch.cuda.device_count() if device.type == "cuda" else 1
    if (device.index or 0) >= count:
        raise ConfigError(
            f"device is {name!r}, but torch sees {count} CUDA devices here; use --device cpu, or "
            f"install a CUDA build of torch."
        )
    return device


@contextmanager
def full_precision() -> Iterator[None]:
    """No TF32 in matrix products: its 10 bits would drown small lobes in rounding."""
    allowed = torch.backends.cuda.matmul.allow_tf32
    torch.backends.cuda.matmul.allow_tf32 = False
    try:
        yield
    finally:
        torch.backends.cuda.matmul.allow_tf32 = allowed


def main(arguments: list[str] | None = None) -> int:
    """The command `spmm fit`; returns the exit code."""
    options = parser().parse_args(arguments)
    try:
        run = run_fit(options)
    except SPMMError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    print(f"{run / REPORT_PAGE}")
    return 0


def parser() -> argparse.ArgumentParser:
    """The options of `spmm fit`."""
    rows = "\n".join(
        f"  {key} ({default}): {meaning}" for key, default, meaning in describe(FitConfig)
    )
    result = argparse.ArgumentParser(
        prog="spmm fit",
        description="Fit a sparse parametric mixture model to a BTF.",
        epilog=f"settings for --config and --set, with their defaults:\n{rows}",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    result.add_argument("input", help="UBO2003 zip or folder, or NPZ")
    result.add_argument("-o", "--output", required=True, metavar="RUN", help="folder to make")
    result.add_argument("--config", metavar="YAML", help="settings; default: configs/default.yaml")
    result.add_argument(
        "--set", action="append", default=[], metavar="KEY=VALUE", help="one setting, repeatable"
    )
    result.add_argument("--device", help="auto, cpu, cuda or cuda:N")
    result.add_argument("--seed", type=int, help="seed of every random choice")
    return result


def run_fit(options: argparse.Namespace) -> Path:
    """Fits as the command line asks and leaves a run folder, whole or not at all."""
    config = FitConfig.from_yaml(options.config) if options.config else FitConfig()
    given = {"device": options.device, "seed": options.seed}
    chosen = [f"{key}={value}" for key, value in given.items() if value is not None]
    config = config.override(options.set + chosen)
    with new_run(options.output) as folder:
        progress = Progress(log=folder / LOG)
        btf = load_btf(options.input, gamma=config.data.gamma)
        result = fit(btf, config, progress)
        write_run(folder, result.model, result.report, config, btf)
        progress.say(headline(result.report))
    return Path(options.output)


if __name__ == "__main__":
    sys.exit(main())
