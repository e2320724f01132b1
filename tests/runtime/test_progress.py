"""Progress: bars on a terminal, plain lines elsewhere and in the log."""

from __future__ import annotations

import io
from pathlib import Path

import pytest

from spmm_torch.runtime.progress import Progress, duration


class Terminal(io.StringIO):
    """A stream that says it is a terminal."""

    def isatty(self) -> bool:
        return True


class Clock:
    """A clock that tests move."""

    def __init__(self) -> None:
        self.now = 0.0

    def __call__(self) -> float:
        return self.now


def run(progress: Progress, clock: Clock, steps: int = 32, seconds: float = 1.0) -> None:
    """A stage of 256 samples in equal steps."""
    with progress.stage("search", total=256, unit="samples") as advance:
        for _ in range(steps):
            clock.now += seconds
            advance(256 // steps)


def test_plain_lines_come_at_most_every_interval() -> None:
    stream, clock = io.StringIO(), Clock()
    run(Progress(stream, clock=clock), clock)
    assert stream.getvalue().splitlines() == [
        "search: 256 samples",
        "search: 31 % (80 of 256 samples), 22 s left",
        "search: 62 % (160 of 256 samples), 12 s left",
        "search: 94 % (240 of 256 samples), 2 s left",
        "search: done in 32.0 s",
    ]


def test_one_of_a_kind_is_in_the_singular() -> None:
    stream = io.StringIO()
    with Progress(stream).stage("render", 1, "eye rays"):
        pass
    assert stream.getvalue().startswith("render: 1 eye ray\n")


def test_a_short_stage_has_two_lines() -> None:
    stream, clock = io.StringIO(), Clock()
    run(Progress(stream, clock=clock), clock, seconds=0.01)
    assert stream.getvalue().splitlines() == ["search: 256 samples", "search: done in 0.3 s"]


def test_a_terminal_shows_a_bar_and_the_log_plain_lines(tmp_path: Path) -> None:
    stream, clock, log = Terminal(), Clock(), tmp_path / "log.txt"
    progress = Progress(stream, log=log, clock=clock)
    progress.say("fitting ROCKS64")
    run(progress, clock)
    shown = stream.getvalue()
    assert "fitting ROCKS64\n" in shown
    assert "\rsearch: 100%|" in shown
    assert "256/256" in shown
    assert "left" not in shown
    lines = log.read_text(encoding="utf-8").splitlines()
    assert lines[:2] == ["fitting ROCKS64", "search: 256 samples"]
    assert lines[-1] == "search: done in 32.0 s"
    assert not any("|" in line or "\r" in line for line in lines)


def test_a_line_said_during_a_bar_stays_whole() -> None:
    stream = Terminal()
    progress = Progress(stream)
    with progress.stage("select", total=4, unit="clusters") as advance:
        advance()
        progress.say("a cluster is empty")
    assert "a cluster is empty\n" in stream.getvalue()


def test_the_log_equals_the_plain_stream(tmp_path: Path) -> None:
    stream, clock, log = io.StringIO(), Clock(), tmp_path / "log.txt"
    progress = Progress(stream, log=log, clock=clock)
    progress.say("hello")
    run(progress, clock)
    assert log.read_text(encoding="utf-8") == stream.getvalue()


def test_a_null_progress_is_silent() -> None:
    for stream in (io.StringIO(), Terminal()):
        progress = Progress(stream, enabled=False)
        progress.say("hello")
        with progress.stage("search", total=2) as advance:
            advance(2)
        assert stream.getvalue() == ""


def test_standard_error_is_the_default(capsys: pytest.CaptureFixture[str]) -> None:
    Progress().say("hello")
    captured = capsys.readouterr()
    assert captured.err == "hello\n"
    assert captured.out == ""


@pytest.mark.parametrize("stream_type", [io.StringIO, Terminal])
def test_a_stage_without_a_total(stream_type: type[io.StringIO]) -> None:
    stream, clock = stream_type(), Clock()
    progress = Progress(stream, clock=clock)
    with progress.stage("dictionary", unit="lobes") as advance:
        clock.now = 11.0
        advance(7)
    if stream.isatty():
        assert "dictionary: 7 lobes [" in stream.getvalue()
    else:
        assert stream.getvalue().splitlines() == [
            "dictionary: started",
            "dictionary: 7 lobes after 11 s",
            "dictionary: done in 11.0 s",
        ]


def test_absolute_counts_as_a_reader_gives_them() -> None:
    stream, clock = io.StringIO(), Clock()
    with Progress(stream, clock=clock).stage("load", unit="views") as advance:
        for done in range(1, 82):
            clock.now += 0.25
            advance.to(done, 81)
        assert (advance.done, advance.total) == (81, 81)
    assert "load: 49 % (40 of 81 views), 10 s left" in stream.getvalue()


def test_a_stage_that_fails_says_so_and_raises() -> None:
    stream, clock = io.StringIO(), Clock()
    with (
        pytest.raises(ValueError, match="planted"),
        Progress(stream, clock=clock).stage("refit", total=3),
    ):
        clock.now = 2.0
        raise ValueError("planted")
    assert stream.getvalue().splitlines()[-1] == "refit: stopped after 2.0 s"


@pytest.mark.parametrize(
    ("seconds", "text"),
    [(0.2, "0 s"), (59.4, "59 s"), (59.6, "1 min 00 s"), (185, "3 min 05 s"), (3725, "1 h 02 min")],
)
def test_duration(seconds: float, text: str) -> None:
    assert duration(seconds) == text
