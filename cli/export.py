"""Write a model for another program, and say what that loses.

Parts of the model that a target does not hold are named, and what was written
is measured against the model: SNR at random places and directions, and FLIP
[Andersson et al. 2020] on a sphere under three lights, 0 for no difference.
"""

from __future__ import annotations

import argparse
from dataclasses import fields
from pathlib import Path
from typing import Any

from spmm_torch.config.fit import FitConfig
from spmm_torch.errors import ConfigError
from spmm_torch.export import PARTS, TARGETS, Target

from .inputs import check_place, check_run
from .parser import Group, ListAction, Parser, add_output, add_run
from .settings import add_setting, add_settings, option_name, read_settings


def add_options(parser: Parser) -> None:
    """The options of `spmm export`."""
    add_run(parser, "run folder or model file")
    add_output(parser, "PATH", "file or folder to make")
    parser.add_argument(
        "--to", required=True, choices=tuple(TARGETS), help="target; --list tells what each is"
    )
    parser.add_argument(
        "--list", action=ListAction, lines=target_lines, help="print all targets and what they hold"
    )
    add_settings(parser, FitConfig, "device")
    groups: dict[str, Group] = {}
    for name, owners in own_settings().items():
        title = f"options of --to {', '.join(each.name for each in owners)}"
        if title not in groups:
            groups[title] = parser.add_argument_group(title)
        add_setting(groups[title], *owners[0].setting(name))


def target_lines() -> list[str]:
    """Every target: its name, what it makes, and which parts of a model it holds."""
    lines = []
    for target in TARGETS.values():
        place = f"X{target.suffix}" if target.suffix else "a folder"
        missing = [part for part in PARTS if part not in target.holds]
        held = f"holds {', '.join(target.holds) or 'a look'}"
        held += f"; leaves out {', '.join(missing)}" if missing else ""
        lines += [f"{target.name:<9} {target.title} ({place})", f"{'':9} {held}"]
    return lines


def own_settings() -> dict[str, list[Target]]:
    """The options that targets have, each with the targets that have it."""
    found: dict[str, list[Target]] = {}
    for target in TARGETS.values():
        for item in fields(target.settings):
            found.setdefault(item.name, []).append(target)
    return found


def run(options: argparse.Namespace) -> list[str]:
    """Exports; the output is whole or not there at all."""
    target = TARGETS[options.to]
    check_run(options.run)
    check_place(options.output)
    check_suffix(options.output, target)
    settings = settings_for(target, options)
    from spmm_torch.export.written import export
    from spmm_torch.model.spmm import SPMM
    from spmm_torch.runtime.device import full_precision, resolve_device
    from spmm_torch.runtime.progress import Progress

    progress = Progress()
    model = SPMM.load(options.run, resolve_device(options.device))
    with full_precision():
        outcome = export(model, target, options.output, settings, progress)
    return [*outcome.lines(), options.output]


def check_suffix(output: str, target: Target) -> None:
    """Checks that the name of an output is one of its target.

    Raises:
        ConfigError: another suffix, or that of another target where a folder is made.
    """
    suffix = Path(output).suffix.lower()
    others = [other.suffix for other in TARGETS.values() if other.suffix]
    if suffix != target.suffix and (target.suffix or suffix in others):
        kind = f"a name in {target.suffix}" if target.suffix else "a folder, without a suffix"
        raise ConfigError(
            f"output {output} does not fit --to {target.name}; expected {kind}; change one of them."
        )


def settings_for(target: Target, options: argparse.Namespace) -> Any:
    """The settings of a target that a command line gives.

    Raises:
        ConfigError: a value out of its range, or an option of other targets alone.
    """
    for name, owners in own_settings().items():
        item, _ = owners[0].setting(name)
        if target not in owners and getattr(options, name) != item.default:
            words = " and ".join(f"--to {each.name}" for each in owners)
            raise ConfigError(
                f"{option_name(name)} is an option of {words}; --to {target.name} does not have "
                f"it; leave it out."
            )
    return read_settings(target.settings, options)
