"""The command `spmm edit`."""

from __future__ import annotations

import argparse
import sys
from typing import NoReturn

from spmm_torch.config.schema import describe
from spmm_torch.edit import EDITS, MASKS, Script
from spmm_torch.edit.examples import packaged, script_path
from spmm_torch.errors import ConfigError, SPMMError
from spmm_torch.runs.edited import edit_run
from spmm_torch.runtime.device import full_precision, resolve_device

INTERACTIVE = "--interactive"


class _Parser(argparse.ArgumentParser):
    """Complains like everything else here: one sentence."""

    def error(self, message: str) -> NoReturn:
        """Raises the complaint.

        Raises:
            ConfigError: always.
        """
        raise ConfigError(f"{message}; spmm edit --help tells what is expected.")


def main(arguments: list[str] | None = None) -> int:
    """The command `spmm edit`; returns the exit code."""
    if INTERACTIVE in (sys.argv[1:] if arguments is None else arguments):
        return interactive(arguments)
    try:
        options = parser().parse_args(arguments)
        script = Script.read(script_path(options.script))
        with full_precision():
            edit_run(options.run, script, options.output, resolve_device(options.device))
    except SPMMError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    print(options.output)
    return 0


def interactive(arguments: list[str] | None) -> int:
    """`spmm edit RUN --interactive`; imported when asked for, as it needs the extra `viz`."""
    from spmm_torch.cli.editor import main

    return main(arguments)


def parser() -> argparse.ArgumentParser:
    """The options of `spmm edit`."""
    result = _Parser(
        prog="spmm edit",
        description="Edit the model of a run by a script, and save it as another run.",
        epilog=_epilog(),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add = result.add_argument
    add("run", metavar="RUN", help="run folder or model file")
    add("script", metavar="SCRIPT", help=f"YAML file, or one of {', '.join(packaged())}")
    add("-o", "--output", required=True, metavar="RUN2", help="folder to make")
    add(INTERACTIVE, action="store_true", help="edit in the browser; takes no SCRIPT")
    add("--device", default="auto", help="auto, cpu, cuda or cuda:N")
    return result


def _epilog() -> str:
    """All edits and masks with their options."""
    parts = []
    for title, kinds in (("edits", EDITS), ("masks", MASKS)):
        parts.append(f"{title}, with their options and defaults:")
        for name, kind in kinds.items():
            parts.append(f"  {name}: {kind.__doc__}")
            parts += [f"    {key} ({default}): {text}" for key, default, text in describe(kind)]
    parts.append("every edit takes a mask; masks combine as {all: [...]}, {any: [...]}, {not: ...}")
    return "\n".join(parts)
