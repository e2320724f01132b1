"""A part of the benchmark in a process of its own, which may fail, hang, or break the device."""

from __future__ import annotations

import faulthandler
import os
import signal
import subprocess
import sys
import tempfile
import time
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import NoReturn

from tests.benchmarks.on_gpu.needs import import_checkout
from tests.benchmarks.on_gpu.rows import Row, read, writer
from tests.benchmarks.on_gpu.schedule import GRACE
from tests.locations import ROOT

LEAST = 5.0  # seconds under which no part is begun: torch alone takes as long to load
LAST_LINES = 40  # of what a part that failed has said
COMMAND = (sys.executable, "-m", __spec__.name if __spec__ else __name__)


@dataclass(frozen=True)
class Ended:
    """How a part ended.

    Attributes:
        rows: what it measured, also before it failed.
        seconds: of the whole process.
        failure: why it failed, in one line; empty: it did not.
        said: the last lines that it wrote, if it failed.
    """

    rows: list[Row]
    seconds: float
    failure: str = ""
    said: str = ""


def run_child(words: list[str], limit: float, command: tuple[str, ...] = COMMAND) -> Ended:
    """Runs a part, and ends it after `limit` seconds.

    Args:
        words: part, device and sizes.
        limit: in seconds.
        command: that runs them, with the place of the rows behind.
    """
    if limit < LEAST and command is COMMAND:
        return Ended([], 0.0, "not begun: out of time")
    with tempfile.TemporaryDirectory(prefix="spmm_torch-gpu-") as name:
        rows, log, start = Path(name) / "rows", Path(name) / "log", time.monotonic()
        with log.open("wb") as stream:
            process = subprocess.Popen(
                [*command, *words, str(rows)],
                cwd=ROOT,
                stdout=stream,
                stderr=subprocess.STDOUT,
                start_new_session=True,
            )
            code = _wait(process, limit)
        seconds, said = time.monotonic() - start, log.read_text("utf-8", "replace").splitlines()
        failure = _failure(code, said, limit)
        last = "\n".join(said[-LAST_LINES:]) if failure else ""
        return Ended(read(rows), seconds, failure, last)


def _wait(process: subprocess.Popen[bytes], limit: float) -> int | None:
    """The exit code; None: its time was over."""
    try:
        return process.wait(limit)
    except subprocess.TimeoutExpired:
        return None
    finally:  # also where this process is to end
        _end(process)


def _end(process: subprocess.Popen[bytes]) -> None:
    """Ends a process and what it started, gently at first, so that it can say where it is."""
    for send in (signal.SIGTERM, signal.SIGKILL):
        if process.poll() is None:
            with suppress(ProcessLookupError, subprocess.TimeoutExpired):
                os.killpg(process.pid, send)
                process.wait(GRACE / 2)


def _failure(code: int | None, said: list[str], limit: float) -> str:
    """Why a part failed, in one line; empty: it did not."""
    if code == 0:
        return ""
    if code is None:
        return f"ended after its {limit:.0f} s"
    last = next((line.strip() for line in reversed(said) if line.strip()), "it said nothing")
    return f"exit code {code}: {last}"


def stop(*_: object) -> NoReturn:
    """Ends a process whose time is over; what it has measured is written."""
    raise SystemExit("it was told to end")


def main(part: str, device: str, sizes: str, place: str) -> None:
    """Runs one part in this process."""
    signal.signal(signal.SIGTERM, stop)
    faulthandler.register(signal.SIGTERM, chain=True)  # says where it is, even inside of C++
    import_checkout()
    from tests.benchmarks.on_gpu.parts import PARTS
    from tests.benchmarks.on_gpu.sizes import FULL, SMALL

    PARTS[part](device, SMALL if sizes == "small" else FULL, writer(Path(place)))


if __name__ == "__main__":
    main(*sys.argv[1:])
