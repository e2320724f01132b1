"""Fit a sparse parametric mixture model to a BTF.

Started with torchrun, several processes share the work.
"""

from __future__ import annotations

import argparse
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import Any

from spmm_torch.config.fit import FitConfig
from spmm_torch.config.schema import describe
from spmm_torch.config.size import parse_size
from spmm_torch.config.written import Written

from .inputs import check_input, check_place
from .parser import Parser, add_cache, add_output, file_name
from .places import rectangle
from .settings import escaped, in_yaml, of_switch, settings_lines

# The options that are short for a setting: its key, the option, and what argparse is to know of it.
SHORT: tuple[tuple[str, str, dict[str, Any]], ...] = (
    ("device", "--device", {"metavar": "DEVICE"}),
    ("seed", "--seed", {"type": Written, "metavar": "N"}),
    ("data.pattern", "--pattern", {"metavar": "NAMES"}),
    ("data.crop", "--crop", {"type": rectangle, "metavar": "X,Y,W,H"}),
    ("data.texels", "--texels", {"type": Written, "metavar": "N"}),
    ("data.directions", "--directions", {"metavar": "K"}),
    ("weights.scene", "--scene", {"type": file_name, "metavar": "YAML"}),
    ("weights.file", "--weights", {"type": file_name, "metavar": "NPZ"}),
    ("auto", "--auto", {"action": "store_const", "const": True}),
)


def add_options(parser: Parser) -> None:
    """The options of `spmm fit`."""
    add = parser.add_argument
    add(
        "input",
        type=file_name,
        metavar="INPUT",
        help="BTF: zip or folder of pictures (UBO2003, ATRIUM, UTIA, OpenEXR, RTI), UBO2014 .btf, "
        "or NPZ; BRDFs: MERL .binary, RGL .bsdf, or a folder of them; or a list of samples (NPZ, "
        "Parquet)",
    )
    add_output(parser, "RUN", "run folder to make")
    add(
        "--config",
        type=file_name,
        metavar="YAML",
        help="settings file, or the name of one that ships: default, fast, quality, paper or smoke "
        "(default: the values below)",
    )
    add(
        "--set",
        action="append",
        default=[],
        metavar="KEY=VALUE",
        help="value of one setting, in YAML, such as select.max_lobes=4; may be repeated",
    )
    add_short(parser)
    add("--resume", action="store_true", help="go on with a run that was stopped")
    add(
        "--no-render",
        action="store_true",
        help="leave out the pictures of both on a sphere and a plane, MSSIM, sharpness, and PSNR "
        "on a display, which takes seconds less",
    )
    add(
        "--max-memory",
        metavar="SIZE",
        help="memory to use at most, such as 4GB, libraries apart; never changes the result "
        "(default: half of what is free)",
    )
    add_cache(parser)
    parser.epilog = "settings for --config and --set, with their defaults:\n\n" + "\n".join(
        settings_lines(FitConfig)
    )


def add_short(parser: Parser) -> None:
    """The options of `SHORT`."""
    rows = {row.key: row for row in describe(FitConfig)}
    for key, option, known in SHORT:
        default = in_yaml(rows[key].default)
        meaning = of_switch(rows[key].meaning) if "action" in known else rows[key].meaning
        text = f"{meaning}; short for --set {key}=... (default: {default})"
        parser.add_argument(option, dest=key, help=escaped(text), **known)


def run(options: argparse.Namespace) -> list[str]:
    """Fits as the command line asks and leaves a run folder, whole or not at all.

    What a stopped run has finished stays beside it, for `--resume`.
    """
    config, memory = config_of(options), memory_of(options)
    if not Path(options.output).exists():
        check_input(options.input)
    elif not options.resume:
        check_place(options.output)
    from spmm_torch.runs.folder import REPORT_PAGE, is_finished, remove_leftovers
    from spmm_torch.runs.inputs import check_finished
    from spmm_torch.runtime.lasting import outliving_terminal
    from spmm_torch.runtime.ranks import speaks

    if options.resume and is_finished(options.output):
        check_finished(options.output, options.input, config)
        if Path(options.input).exists():  # else it was moved, as the run may have been
            check_content(options, config)
        remove_leftovers(options.output)
    else:
        with outliving_terminal():
            fit_run(options, config, memory)
    return [str(Path(options.output) / REPORT_PAGE)] if speaks() else []


def check_content(options: argparse.Namespace, config: FitConfig) -> None:
    """Checks that a finished run was fit to what the input holds now.

    Raises:
        SPMMError: it was fit to something else, or the input cannot be read.
    """
    from spmm_torch.data import load_input
    from spmm_torch.fit.weighting import given_weights
    from spmm_torch.runs.fingerprint import fingerprint
    from spmm_torch.runs.inputs import check_contents

    btf = load_input(options.input, config.data, config.seed)
    weights = given_weights(btf, config.weights)
    check_contents(options.output, fingerprint(btf, config, weights))


def memory_of(options: argparse.Namespace) -> int | None:
    """The bytes of --max-memory; None without it.

    Raises:
        ConfigError: it is no size.
    """
    return parse_size(options.max_memory) if options.max_memory is not None else None


def fit_run(options: argparse.Namespace, config: FitConfig, memory: int | None) -> None:
    """Fits in at most `memory` bytes, and writes the run folder."""
    from spmm_torch.data import load_input
    from spmm_torch.evaluate import opening_section
    from spmm_torch.fit import fit
    from spmm_torch.fit.weighting import given_weights
    from spmm_torch.report.summary import headline
    from spmm_torch.runs.fingerprint import contents_of, fingerprint, key_of
    from spmm_torch.runs.folder import LOG, STATE, new_run, unfinished, write_run
    from spmm_torch.runtime.context import Context
    from spmm_torch.runtime.device import local_device, resolve_device
    from spmm_torch.runtime.progress import Progress
    from spmm_torch.runtime.ranks import joined_ranks

    config = replace(config, device=local_device(config.device))
    cache = Path(options.cache) if options.cache else None
    btf = load_input(options.input, config.data, config.seed)
    weights = given_weights(btf, config.weights)
    with ExitStack() as held:
        ranks = held.enter_context(joined_ranks(resolve_device(config.device)))
        log = unfinished(options.output) / LOG if ranks.is_first else None
        progress = Progress(log=log, enabled=ranks.is_first)
        facts = ranks.first(lambda: fingerprint(btf, config, weights))
        folder = held.enter_context(
            new_run(options.output, facts, options.resume, ranks, progress.say)
        )
        context = Context.build(
            config.device,
            config.seed,
            memory=memory,
            progress=progress,
            ranks=ranks,
            state=folder / STATE,
            cache=cache,
            depends_on=key_of(facts),
        )
        result = fit(btf, config, context, weights=weights, render=not options.no_render)
        if ranks.is_first:
            sections = []
            if (seen := result.looks) is not None:
                sections = [opening_section(seen.likeness.spheres, seen.planes)]
            report = replace(result.figures, contents=contents_of(facts))
            write_run(folder, result.model, report, config, btf, sections)
            context.progress.say(headline(report))


def config_of(options: argparse.Namespace) -> FitConfig:
    """The settings: those of --config, then --set, then the options of `SHORT`.

    Raises:
        ConfigError: a file that cannot be read, an unknown key, or a value out of its range.
    """
    from spmm_torch.config.shipped import settings_of

    config = settings_of(options.config) if options.config else FitConfig()
    given = {key: vars(options)[key] for key, _, _ in SHORT}
    changes = {key: value for key, value in given.items() if value is not None}
    return config.override(options.set).changed(changes)
