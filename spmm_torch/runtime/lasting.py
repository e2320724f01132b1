"""Streams that may go away: a run outlives its terminal, and whoever reads from it."""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from threading import current_thread, main_thread
from typing import Any, TextIO, cast


class LastingStream:
    """A stream whose loss harms nobody: what is written to it from then on is dropped.

    A terminal hangs up, a disk is full, `head` has read enough.

    Args:
        stream: the stream; None for one that was closed before the process began.
    """

    def __init__(self, stream: TextIO | None) -> None:
        self.stream = stream
        self.lost = stream is None
        self.reason: OSError | None = None  # why it was lost, as the system puts it

    def __getattr__(self, name: str) -> Any:
        """Whatever else streams have."""
        if name == "stream":  # a stop in the midst of `__init__`
            raise AttributeError(name)
        return getattr(self.stream, name)

    def write(self, text: str) -> int:
        """Writes a text, in escapes what the stream has no letters for."""
        if self.stream is not None and not self.lost:
            try:
                self.stream.write(text)
            except UnicodeEncodeError:
                self.write(text.encode("ascii", "backslashreplace").decode())
            except (OSError, ValueError) as error:
                self._lose(error)
        return len(text)

    def flush(self) -> None:
        """Hands on what was written."""
        if self.stream is not None and not self.lost:
            try:
                self.stream.flush()
            except (OSError, ValueError) as error:
                self._lose(error)

    def isatty(self) -> bool:
        """Whether it is a terminal that is still there."""
        try:
            return self.stream is not None and not self.lost and self.stream.isatty()
        except ValueError:  # closed
            return False

    def _lose(self, error: Exception) -> None:
        """Drops all from now on, and what the stream still holds: Python complains of it else."""
        self.lost, self.reason = True, error if isinstance(error, OSError) else None
        with suppress(OSError, ValueError, AttributeError):
            nowhere = os.open(os.devnull, os.O_WRONLY)
            os.dup2(nowhere, cast("TextIO", self.stream).fileno())
            os.close(nowhere)


def lasting(stream: TextIO | None) -> TextIO:
    """The stream as a `LastingStream`; the same where it is one already."""
    known = isinstance(stream, LastingStream)
    return cast("TextIO", stream if known else LastingStream(stream))


@contextmanager
def lasting_errors() -> Iterator[None]:
    """Makes standard error a `LastingStream` within the block under `with`."""
    before = sys.stderr
    sys.stderr = lasting(before)
    try:
        yield
    finally:
        sys.stderr = before


@contextmanager
def outliving_terminal() -> Iterator[None]:
    """Within the block under `with` this process goes on when its terminal hangs up, as by `nohup`.

    Elsewhere than in the main thread, which alone may ask for it, nothing changes.
    """
    if not hasattr(signal, "SIGHUP") or current_thread() is not main_thread():  # Windows has none
        yield
        return
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGHUP, before)
