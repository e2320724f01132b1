"""Seconds by stage, with a clock of the test's own."""

from __future__ import annotations

import itertools

import pytest
import torch

from spmm_torch.runtime import stopwatch
from spmm_torch.runtime.stopwatch import Stopwatch


@pytest.fixture
def watch(monkeypatch: pytest.MonkeyPatch) -> Stopwatch:
    """A clock that goes on by one second each time it is read."""
    ticks = itertools.count()
    monkeypatch.setattr(stopwatch, "perf_counter", lambda: float(next(ticks)))
    return Stopwatch(torch.device("cpu"))


def test_stages_add_up(watch: Stopwatch) -> None:
    for _ in range(3):
        with watch("search"):
            pass
    with watch("load"):
        pass
    assert watch.seconds == {"search": 3.0, "load": 1.0}


def test_nested_stages_both_count(watch: Stopwatch) -> None:
    with watch("total"), watch("load"):
        pass
    assert watch.seconds == {"load": 1.0, "total": 3.0}


def test_running_stages_can_be_counted_up(watch: Stopwatch) -> None:
    with watch("total"), watch("refit"):
        watch.count_up()
        assert watch.seconds == {"total": 2.0, "refit": 1.0}
    assert watch.seconds == {"total": 4.0, "refit": 2.0}


def test_failed_stages_count(watch: Stopwatch) -> None:
    with pytest.raises(ValueError, match="no"), watch("load"):
        raise ValueError("no")
    assert watch.seconds == {"load": 1.0}


def test_work_side_by_side_counts_in_shares(watch: Stopwatch) -> None:
    with watch("select"):
        pass
    for _ in range(2):
        part = watch.one_of(2)
        with part("select"):
            pass
        with part.one_of(2)("refit"):
            pass  # counts in a part of its own
        watch.take(part)
    assert watch.seconds == {"select": 2.0}


@pytest.mark.gpu(simulated=False)  # which has no queue, and so no events
def test_waits_for_the_gpu() -> None:
    watch = Stopwatch(torch.device("cuda"))
    done = torch.cuda.Event()
    with watch("work"):
        product = torch.rand(4096, 4096, device="cuda")
        for _ in range(8):
            product = product @ product
        done.record()
    assert done.query()
    assert watch.seconds["work"] > 0.0
