"""Print a script by which a shell completes commands, options and files of spmm.

bash:  spmm completion bash > ~/.local/share/bash-completion/completions/spmm
zsh:   spmm completion zsh > ~/.zfunc/_spmm (fpath+=~/.zfunc before compinit)
tcsh:  spmm completion tcsh > ~/.spmm.tcsh (and source it in ~/.tcshrc)
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator

from .parser import Parser, file_name

SHELLS = ("bash", "zsh", "tcsh")


def add_options(parser: Parser) -> None:
    """The options of `spmm completion`."""
    parser.add_argument("shell", choices=SHELLS, help="shell that is to complete spmm")


def run(options: argparse.Namespace) -> list[str]:
    """The script."""
    import shtab

    from .main import parser

    root = parser()
    for action in actions(root):
        if action.type is file_name:
            setattr(action, "complete", shtab.FILE)  # noqa: B010 (shtab looks for this name)
    return [shtab.complete(root, options.shell)]


def actions(parser: argparse.ArgumentParser) -> Iterator[argparse.Action]:
    """Every argument and option of a parser and of its commands."""
    for action in parser._actions:
        yield action
        if isinstance(action, argparse._SubParsersAction):
            for command in action.choices.values():
                yield from actions(command)
