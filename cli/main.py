"""`spmm COMMAND ...`: the table of commands, and the one place that runs them."""

from __future__ import annotations

import argparse
import inspect
import os
import signal
import sys
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from importlib import import_module
from threading import Event, current_thread, main_thread
from types import ModuleType
from typing import NoReturn

from spmm_torch import __version__
from spmm_torch.errors import SPMMError
from spmm_torch.runtime.allocator import keep_freed_memory
from spmm_torch.runtime.lasting import lasting_errors

from .parser import Parser, print_lines

# What Pillow warns of, sizes of pictures, is checked where these are read.
PILLOW_WARNING = "Image size .* could be decompression bomb"
# Exit codes: of bad input, and of a command that Ctrl-C has ended, as shells give it.
BAD_INPUT, STOPPED = 2, 130
# Threads of torch that wait for work give way to other programs, in place of spinning; they are
# read when torch is loaded.
PASSIVE = {"OMP_WAIT_POLICY": "PASSIVE", "KMP_BLOCKTIME": "0"}
TOO_LITTLE_MEMORY = (
    "there is too little memory; expected more, or less to do; close other programs, fit a part by "
    "--crop or --texels, or lower --max-memory or --size."
)
NOTHING_WRITTEN = "stopped; nothing was written."


@dataclass(frozen=True)
class Command:
    """A command of `spmm`, whose name is that of its module.

    Attributes:
        meaning: what it does, in the list of commands.
        stopped: what is said once Ctrl-C has ended it.
    """

    meaning: str
    stopped: str = "stopped."


COMMANDS: dict[str, Command] = {
    "fit": Command(
        "fit a model to a BTF",
        "stopped; the same command with --resume goes on from the last finished stage.",
    ),
    "check": Command("look at the values of a BTF before a fit"),
    "evaluate": Command("judge a run: errors, MSSIM, and where it fails"),
    "figures": Command("draw the figures of the paper for a run", NOTHING_WRITTEN),
    "render": Command("render a model or a BTF on a sphere or a plane", NOTHING_WRITTEN),
    "edit": Command("edit a model, by a script or in the browser", NOTHING_WRITTEN),
    "export": Command("write a model for another program", NOTHING_WRITTEN),
    "view": Command("show the lobes of a texel, a mosaic, or maps of a model"),
    "convert": Command("write a BTF in another format", NOTHING_WRITTEN),
    "crop": Command("cut a rectangle out of a BTF of JPEG pictures", NOTHING_WRITTEN),
    "synthesize": Command("path-trace a BTF from texture maps", NOTHING_WRITTEN),
    "benchmark": Command("measure speed against error on this machine", NOTHING_WRITTEN),
    "cache": Command("show or clear the cache of decoded BTFs"),
    "completion": Command("print a script by which a shell completes spmm"),
}


def main(arguments: list[str] | None = None) -> int:
    """Runs a command.

    Args:
        arguments: of the command line, without the name of the program; None: those of the process.

    Returns:
        The exit code: 0, 1 where a command says so in its help, 2 for bad input, 130 after Ctrl-C.

    Raises:
        SystemExit: after a help text was printed.
    """
    if "torch" not in sys.modules:
        os.environ.update(
            {name: value for name, value in PASSIVE.items() if name not in os.environ}
        )
        keep_freed_memory()
    warnings.filterwarnings("ignore", message=PILLOW_WARNING)
    given = sys.argv[1:] if arguments is None else arguments
    with lasting_errors(), plain_warnings(), interruptible() as interrupted:
        stopped = Command.stopped
        try:
            command = given[0] if given and given[0] in COMMANDS else None
            stopped = COMMANDS[command].stopped if command else stopped
            return run_command(given, command)
        except SPMMError as error:
            return complain(f"error: {error}", BAD_INPUT)
        except BaseException as error:
            # What Ctrl-C meets in the midst of an import may come out as any exception.
            if interrupted.is_set() or isinstance(error, KeyboardInterrupt):
                return complain(stopped, STOPPED)
            if is_memory(error):
                return complain(f"error: {TOO_LITTLE_MEMORY}", BAD_INPUT)
            if isinstance(error, OSError) and isinstance(error.filename, str | bytes):
                return complain(f"error: {unusable(error)}", BAD_INPUT)
            raise


def run_command(given: Sequence[str], command: str | None) -> int:
    """Runs a command and prints what it has made; the exit code.

    Raises:
        SPMMError: bad input.
        SystemExit: after a help text was printed.
    """
    root = parser([command] if command else [])
    if not given:
        root.print_help()
        return BAD_INPUT
    options, unknown = root.parse_known_args(given)
    if unknown:
        options.parser.error(f"unrecognized arguments: {' '.join(unknown)}")
    print_lines(module_of(options.command).run(options))
    return options.exit_code


def complain(text: str, code: int) -> int:
    """Says a sentence on standard error; gives the exit code."""
    print(text, file=sys.stderr, flush=True)
    return code


@contextmanager
def plain_warnings() -> Iterator[None]:
    """Within the block under `with`, a warning is shown as one line, without a line of code."""

    def in_one_line(message: Warning | str, *_: object) -> str:
        return f"warning: {' '.join(str(message).split())}\n"

    before = warnings.formatwarning
    warnings.formatwarning = in_one_line
    try:
        yield
    finally:
        warnings.formatwarning = before


@contextmanager
def interruptible() -> Iterator[Event]:
    """Within the block under `with`, Ctrl-C raises KeyboardInterrupt and sets the event."""
    interrupted = Event()

    def interrupt(*_: object) -> NoReturn:
        interrupted.set()
        raise KeyboardInterrupt

    before = signal.getsignal(signal.SIGINT)
    ours = before is signal.default_int_handler and current_thread() is main_thread()
    if ours:  # else the shell wants it ignored, as it does for jobs in the background
        signal.signal(signal.SIGINT, interrupt)
    try:
        yield interrupted
    finally:
        if ours:
            signal.signal(signal.SIGINT, before)


def unusable(error: OSError) -> str:
    """What is wrong with a file or folder that the system refuses, wherever that comes out."""
    return (
        f"{os.fsdecode(error.filename)} cannot be used ({error.strerror}); expected a place that "
        f"can be read and written; check the path, its permissions and the disk."
    )


def is_memory(error: BaseException) -> bool:
    """Whether an error is one of memory, by Python or, in other words, by torch."""
    words = ("allocate memory", "out of memory")
    by_torch = isinstance(error, RuntimeError) and any(word in str(error) for word in words)
    return by_torch or isinstance(error, MemoryError)


def parser(commands: Sequence[str] = tuple(COMMANDS)) -> Parser:
    """The parser of all commands, with the options of some: others are not imported."""
    result = Parser(
        prog="spmm",
        description="Sparse parametric mixture models of measured BTFs.",
        epilog="spmm fit INPUT -o RUN makes the folder RUN, which most other commands take. "
        "spmm COMMAND --help tells more.",
    )
    result.add_argument(
        "-V", "--version", action="version", version=__version__, help="print the version and exit"
    )
    added_to = result.add_subparsers(
        title="commands", dest="command", metavar="COMMAND", required=True, help="what to do"
    )
    for name, command in COMMANDS.items():
        added = added_to.add_parser(
            name,
            help=command.meaning,
            formatter_class=argparse.RawDescriptionHelpFormatter,
        )
        added.set_defaults(parser=added, exit_code=0)
        if name in commands:
            module = module_of(name)
            added.description = inspect.getdoc(module)
            module.add_options(added)
    return result


def module_of(command: str) -> ModuleType:
    """The module of a command."""
    return import_module(f".{command}", __package__)


if __name__ == "__main__":
    sys.exit(main())
