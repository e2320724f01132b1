"""The parser of all command lines, and the options that are the same everywhere."""

from __future__ import annotations

import argparse
import errno
import re
import sys
from collections.abc import Callable, Iterable, Sequence
from typing import Any, NoReturn, Protocol

from spmm_torch.config.written import Written
from spmm_torch.errors import ConfigError, OutputError
from spmm_torch.runtime.lasting import LastingStream

# Of a stream whose reader has read enough, such as head, or that was closed.
NOBODY_READS = (errno.EPIPE, errno.EBADF)
# Options begin with a letter: -1GB and -1 are values, which are then judged as such.
VALUE = re.compile(r"-\.?\d")


class Parser(argparse.ArgumentParser):
    """An argument parser that raises its complaints, so that they end like all others."""

    def __init__(self, **settings: Any) -> None:
        super().__init__(**settings)
        self._negative_number_matcher = VALUE

    def error(self, message: str) -> NoReturn:
        """Raises the complaint.

        Raises:
            ConfigError: always.
        """
        raise ConfigError(f"{message}; {self.prog} --help tells what is expected.")


class Group(Protocol):
    """A parser, or a part of its options with a title of their own."""

    def add_argument(self, *names: str, **settings: Any) -> argparse.Action:
        """Adds an argument or option."""
        ...


class ListAction(argparse.Action):
    """An option that prints lines and ends the command, whatever else is given.

    Args:
        lines: makes them, once they are asked for.
    """

    def __init__(self, *, lines: Callable[[], Iterable[str]], **settings: Any) -> None:
        super().__init__(nargs=0, **settings)
        self.lines = lines

    def __call__(
        self,
        parser: argparse.ArgumentParser,
        namespace: argparse.Namespace,
        values: str | Sequence[Any] | None,
        option_string: str | None = None,
    ) -> None:
        """Prints the lines and exits with code 0."""
        print_lines(self.lines())
        parser.exit()


def print_lines(lines: Iterable[str]) -> None:
    """Prints lines for as long as somebody reads them.

    Raises:
        OutputError: standard output cannot be written, such as a file on a full disk.
    """
    output = LastingStream(sys.stdout)
    for line in lines:
        output.write(f"{line}\n")
    output.flush()
    if output.reason is not None and output.reason.errno not in NOBODY_READS:
        raise OutputError(
            f"standard output cannot be written ({output.reason}); the command itself is done; "
            f"send its output elsewhere."
        ) from output.reason


def file_name(text: str) -> str:
    """The name of a file or folder as it was typed: shells complete arguments of this `type`.

    Raises:
        ArgumentTypeError: it is empty, as where a shell's variable is not set.
    """
    if not text:
        raise argparse.ArgumentTypeError("'' is no name; expected that of a file or folder")
    return text


def whole_number(text: str) -> int:
    """The `type` of an option that takes a whole number and is no setting.

    Raises:
        ArgumentTypeError: it is none.
    """
    return _number(text, int, "whole number such as 12")


def number(text: str) -> float:
    """The `type` of an option that takes a number and is no setting.

    Raises:
        ArgumentTypeError: it is none.
    """
    return _number(text, float, "number such as 2.2")


def _number(text: str, kind: type, what: str) -> Any:
    try:
        return Written(text).as_type(kind)
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} is no number; expected a {what}") from None


def add_run(parser: Group, meaning: str = "run folder") -> None:
    """The argument RUN."""
    parser.add_argument("run", type=file_name, metavar="RUN", help=meaning)


def add_output(parser: Group, metavar: str, meaning: str, *, required: bool = True) -> None:
    """The option -o."""
    parser.add_argument(
        "-o", "--output", type=file_name, required=required, metavar=metavar, help=meaning
    )


def add_against(parser: Group) -> None:
    """The options for commands that need what was measured beside the model."""
    parser.add_argument(
        "--against",
        type=file_name,
        metavar="INPUT",
        help="BTF to compare with (default: the input of RUN)",
    )
    parser.add_argument(
        "--pattern",
        metavar="NAMES",
        help="how its pictures are named, such as L{tl}_{pl}_V{tv}_{pv} (default: as those that "
        "RUN was fitted to)",
    )


def add_cache(parser: Group) -> None:
    """The option --cache, for commands that decode a BTF."""
    parser.add_argument(
        "--cache",
        type=file_name,
        metavar="FOLDER",
        help="folder that keeps the decoded BTF for later commands (default: the user's cache "
        "folder, and only for a BTF that does not fit in memory)",
    )
