"""Edit the model of a run by a script, and save it as another run.

With --interactive, edit it in the browser.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator

from spmm_torch.config.fit import FitConfig
from spmm_torch.errors import ConfigError

from . import editor
from .inputs import check_place, check_run
from .parser import ListAction, Parser, add_output, add_run, file_name
from .settings import add_settings, settings_lines


def add_options(parser: Parser) -> None:
    """The options of `spmm edit`."""
    add = parser.add_argument
    add_run(parser, "run folder or model file")
    add(
        "script",
        nargs="?",
        type=file_name,
        metavar="SCRIPT",
        help="YAML file of edits, or the name of an example; --list shows both",
    )
    add_output(parser, "RUN2", "run folder to make", required=False)
    add_settings(parser, FitConfig, "device")
    add(
        "--list",
        action=ListAction,
        lines=edit_lines,
        help="print all edits and masks with their options, and the examples",
    )
    editor.add_options(parser.add_argument_group("in the browser"))


def run(options: argparse.Namespace) -> list[str]:
    """Edits the run, or opens the editor.

    Raises:
        SPMMError: bad input, or a script that cannot be followed.
    """
    if options.interactive:
        if options.script is not None:
            raise ConfigError(
                f"SCRIPT {options.script} is given with --interactive; expected one of the two; "
                f"follow the script first, and open the run that it makes."
            )
        return editor.run(options)
    if options.script is None or options.output is None:
        missing = "SCRIPT" if options.script is None else "-o RUN2"
        raise ConfigError(f"{missing} is missing; spmm edit --help tells what is expected.")
    check_run(options.run)
    check_place(options.output)
    from spmm_torch.edit import Script
    from spmm_torch.edit.examples import script_path
    from spmm_torch.runs.edited import edit_run
    from spmm_torch.runtime.device import full_precision, resolve_device

    script = Script.read(script_path(options.script))
    with full_precision():
        edit_run(options.run, script, options.output, resolve_device(options.device))
    return [options.output]


def edit_lines() -> Iterator[str]:
    """All that a script may hold, and the examples."""
    from spmm_torch.edit import EDITS, MASKS
    from spmm_torch.edit.examples import packaged

    for title, kinds in (("edits", EDITS), ("masks", MASKS)):
        yield f"{title}, with their options and defaults:"
        for name, kind in kinds.items():
            yield f"  {name}: {kind.__doc__}"
            yield from settings_lines(kind, 6)
    yield "every edit takes a mask; masks combine as {all: [...]}, {any: [...]}, {not: ...}"
    yield f"examples: {', '.join(packaged())}"
