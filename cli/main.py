"""`spmm COMMAND ...`: one subcommand for each job."""

from __future__ import annotations

import sys
from collections.abc import Callable

from spmm_torch import __version__
from spmm_torch.cli import (
    benchmark,
    cache,
    convert,
    edit,
    evaluate,
    figures,
    fit,
    render,
    synthesize,
)


def view(arguments: list[str]) -> int:
    """`spmm view`; imported when it is asked for, as it needs the extra `viz`."""
    from spmm_torch.cli.view import main

    return main(arguments)


COMMANDS: dict[str, tuple[Callable[[list[str]], int], str]] = {
    "fit": (fit.main, "fit a model to a BTF: spmm fit INPUT -o RUN"),
    "evaluate": (evaluate.main, "judge a run: errors, MSSIM, where it fails: spmm evaluate RUN"),
    "figures": (figures.main, "the figures of the paper for a run: spmm figures RUN -o OUT"),
    "render": (
        render.main,
        "picture of a model or BTF on a sphere or plane: spmm render RUN -o X.png",
    ),
    "edit": (edit.main, "edit a model by a script: spmm edit RUN SCRIPT -o RUN2"),
    "view": (view, "lobes of a texel, mosaic and maps of a model: spmm view RUN --texel X,Y"),
    "convert": (convert.main, "write a BTF in another format: spmm convert INPUT -o OUT"),
    "synthesize": (
        synthesize.main,
        "path-trace a BTF from texture maps: spmm synthesize ... -o OUT",
    ),
    "benchmark": (benchmark.main, "speed against error, on this machine: spmm benchmark -o OUT"),
    "cache": (cache.main, "show or clear the cache of decoded BTFs: spmm cache list|clear"),
}


def usage() -> str:
    """What `spmm --help` prints."""
    rows = "\n".join(f"  {name:<10} {meaning}" for name, (_, meaning) in COMMANDS.items())
    head = f"spmm {__version__}\n\nusage: spmm COMMAND ..."
    return f"{head}\n\n{rows}\n\nspmm COMMAND --help tells more."


def main(arguments: list[str] | None = None) -> int:
    """Runs a subcommand and returns its exit code; 2 for bad input."""
    given = sys.argv[1:] if arguments is None else arguments
    if not given or given[0] in ("-h", "--help"):
        print(usage())
        return 0 if given else 2
    if given[0] == "--version":
        print(__version__)
        return 0
    if given[0] not in COMMANDS:
        known = ", ".join(COMMANDS)
        print(f"error: unknown command {given[0]}; expected one of {known}.", file=sys.stderr)
        return 2
    return COMMANDS[given[0]][0](given[1:])
