"""The command line of `spmm fit`."""

from __future__ import annotations

import argparse
import sys
from dataclasses import replace
from pathlib import Path

from spmm_torch.cli.parser import STOPPED
from spmm_torch.config.fit import FitConfig
from spmm_torch.config.schema import describe
from spmm_torch.data import load_input
from spmm_torch.errors import SPMMError
from spmm_torch.evaluate import sphere_section
from spmm_torch.fit import fit
from spmm_torch.fit.weighting import given_weights
from spmm_torch.report.summary import headline
from spmm_torch.runs.folder import (
    LOG,
    REPORT_PAGE,
    STATE,
    fingerprint,
    is_finished,
    new_run,
    remove_leftovers,
    write_run,
)
from spmm_torch.runtime.context import Context
from spmm_torch.runtime.device import local_device, resolve_device
from spmm_torch.runtime.memory import parse_size
from spmm_torch.runtime.progress import Progress
from spmm_torch.runtime.ranks import joined_ranks, speaks


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
    add("--scene", metavar="YAML", help="errors count by what the pictures of this scene show")
    add(
        "--weights", metavar="NPZ", help="errors count by pair [V, L] and texel [H, W] in this file"
    )
    add(
        "--auto",
        action="store_const",
        const=True,
        help="leave out models and lobes that do not pay for their bytes on held-out directions",
    )
    add("--resume", action="store_true", help="go on with a run that was stopped")
    add("--no-render", action="store_true", help="no sphere pictures, so no MSSIM; saves seconds")
    add("--max-memory", metavar="SIZE", help="such as 4GB; default: half of what is free")
    add("--cache", metavar="FOLDER", help="keep decoded values here, for later runs too")
    return result


def assignments(options: argparse.Namespace) -> list[str]:
    """Settings that have an option of their own."""
    given = {
        "device": options.device,
        "seed": options.seed,
        "auto": "true" if options.auto else None,
        "data.crop": f"[{options.crop}]" if options.crop else None,
        "data.texels": options.texels,
        "data.directions": f"'{options.directions}'" if options.directions else None,
        "weights.scene": f"'{options.scene}'" if options.scene else None,
        "weights.file": f"'{options.weights}'" if options.weights else None,
    }
    return [f"{key}={value}" for key, value in given.items() if value is not None]


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


def run_fit(options: argparse.Namespace) -> Path:
    """Fits as the command line asks and leaves a run folder, whole or not at all.

    What a stopped run has finished stays beside it, for `--resume`.
    """
    if options.resume and is_finished(options.output):
        remove_leftovers(options.output)
        return Path(options.output)
    config = FitConfig.from_yaml(options.config) if options.config else FitConfig()
    config = config.override(options.set + assignments(options))
    config = replace(config, device=local_device(config.device))
    memory = parse_size(options.max_memory) if options.max_memory else None
    cache = Path(options.cache) if options.cache else None
    btf = load_input(options.input, config.data, config.seed)
    weights = given_weights(btf, config.weights)
    depends_on = fingerprint(btf, config) | {"weights": weights.digest()}
    with (
        joined_ranks(resolve_device(config.device)) as ranks,
        new_run(options.output, depends_on, options.resume, ranks) as folder,
    ):
        context = Context.build(
            config.device,
            config.seed,
            memory=memory,
            progress=Progress(log=folder / LOG if ranks.is_first else None, enabled=ranks.is_first),
            ranks=ranks,
            state=folder / STATE,
            cache=cache,
        )
        result = fit(btf, config, context, weights=weights, render=not options.no_render)
        if ranks.is_first:
            sections = [] if result.likeness is None else [sphere_section(result.likeness)]
            write_run(folder, result.model, result.figures, config, btf, sections)
            context.progress.say(headline(result.figures))
    return Path(options.output)
