"""The first and the last lines of the program `spmm`, where Ctrl-C would show a traceback."""

from __future__ import annotations

import signal
import sys

# As in `main.py`, which is not there yet.
STOPPED = 130


def start(arguments: list[str] | None = None) -> int:
    """Runs a command, after which the process ends; the exit code.

    Args:
        arguments: of the command line, without the name of the program; None: those of the process.
    """
    try:
        from .main import main  # takes a tenth of a second

        return main(arguments)
    except KeyboardInterrupt:
        print("stopped.", file=sys.stderr, flush=True)
        return STOPPED
    finally:
        if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
            signal.signal(signal.SIGINT, signal.SIG_DFL)  # nothing is left to be stopped
