"""Streams that may go away harm nobody."""

from __future__ import annotations

import errno
import io
import os
import signal
import sys
from pathlib import Path

import pytest

from spmm_torch.runtime.lasting import LastingStream, lasting, lasting_errors, outliving_terminal
from spmm_torch.runtime.progress import Progress


class Failing(io.StringIO):
    """A stream that fails with one number of the system from a given write on."""

    def __init__(self, code: int, after: int = 1) -> None:
        super().__init__()
        self.code, self.left = code, after

    def write(self, text: str) -> int:
        if self.left <= 0:
            raise OSError(self.code, os.strerror(self.code))
        self.left -= 1
        return super().write(text)


@pytest.mark.parametrize("code", [errno.EPIPE, errno.ENOSPC, errno.EIO, errno.EBADF])
def test_what_comes_after_the_loss_is_dropped(code: int) -> None:
    inner = Failing(code)
    stream = LastingStream(inner)
    for text in ("one", "two", "three"):
        assert stream.write(text) == len(text)
        stream.flush()
    assert inner.getvalue() == "one"
    assert stream.lost and not stream.isatty()
    assert stream.reason is not None and stream.reason.errno == code


@pytest.mark.parametrize("closed", [False, True])
def test_a_stream_that_is_not_there(closed: bool) -> None:
    inner = io.StringIO() if closed else None
    if inner is not None:
        inner.close()
    stream = LastingStream(inner)
    assert stream.write("one") == 3 and not stream.isatty()
    stream.flush()
    assert stream.lost and stream.reason is None


def test_letters_that_a_stream_lacks_are_escaped() -> None:
    raw = io.BytesIO()
    stream = lasting(io.TextIOWrapper(raw, encoding="ascii"))
    print("M\u00fcnchen \udcff", file=stream, flush=True)
    assert raw.getvalue() == rb"M\xfcnchen \udcff" + os.linesep.encode()
    assert lasting(stream) is stream


def test_progress_goes_on_in_the_log(tmp_path: Path) -> None:
    log = tmp_path / "log.txt"
    progress = Progress(Failing(errno.EPIPE), log=log)
    with progress.stage("search", 2):
        progress.say("a line \udcff")
    assert [line.split(":")[0] for line in log.read_text().splitlines()] == [
        "search",
        r"a line \udcff",
        "search",
    ]


def test_standard_error_is_given_back() -> None:
    before = sys.stderr
    with lasting_errors():
        assert isinstance(sys.stderr, LastingStream)
    assert sys.stderr is before


@pytest.mark.skipif(not hasattr(signal, "SIGHUP"), reason="Windows has no SIGHUP")
def test_a_hang_up_is_ignored() -> None:
    before = signal.getsignal(signal.SIGHUP)
    with outliving_terminal():
        os.kill(os.getpid(), signal.SIGHUP)
    assert signal.getsignal(signal.SIGHUP) == before
