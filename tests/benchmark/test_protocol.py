"""Repeats, warm-up and spread; the environment."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest
import torch

from spmm_torch.benchmark import protocol
from spmm_torch.benchmark.environment import commit, environment
from spmm_torch.benchmark.protocol import Protocol, Timing, forget_peak, measure, stage_medians
from spmm_torch.runtime.memory import peak_resident_memory

CPU = torch.device("cpu")


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """A clock whose seconds the work itself adds."""
    seconds = [0.0]
    monkeypatch.setattr(protocol, "now", lambda device: seconds[0])
    return seconds


def work_of(clock: list[float], *seconds: float) -> list[float]:
    """Work that takes the given seconds, call after call."""
    left = list(seconds)

    def work() -> float:
        clock[0] += left[0]
        return left.pop(0)

    return work


def test_the_warm_up_does_not_count(clock: list[float]) -> None:
    result, timing = measure(work_of(clock, 100.0, 3.0, 1.0, 2.0), Protocol(3, 60.0), CPU)
    assert timing.runs == pytest.approx((3.0, 1.0, 2.0))
    assert result == 2.0
    assert timing.to_dict() == {"median": 2.0, "fastest": 1.0, "slowest": 3.0, "runs": 3}


def test_long_work_is_repeated_less(clock: list[float]) -> None:
    work = work_of(clock, 7.0, 7.0, 7.0)
    assert measure(work, Protocol(9, 10.0), CPU, warm_up=False)[1].runs == (7.0, 7.0)


def test_at_least_one_run(clock: list[float]) -> None:
    assert measure(work_of(clock, 5.0), Protocol(1, 0.0), CPU, warm_up=False)[1] == Timing((5.0,))


def test_stages_by_their_medians() -> None:
    reports = [{"seconds": {"search": a, "total": b}} for a, b in ((1, 9), (2, 8), (30, 7))]
    assert stage_medians(reports) == {"search": 2, "total": 8}


@pytest.mark.skipif(not protocol.PEAK_RESET.exists(), reason="Linux only")
def test_the_peak_of_memory_starts_anew() -> None:
    if not forget_peak(CPU):
        pytest.skip("the system does not allow it")
    before = peak_resident_memory()
    block = torch.ones(1 << 25)
    assert peak_resident_memory() >= before + 4 * len(block) - (1 << 20)
    del block
    assert forget_peak(CPU)
    assert peak_resident_memory() < before + (1 << 26)


def test_the_environment_is_named() -> None:
    facts = environment(CPU)
    assert facts["cpu"] and facts["threads"] == torch.get_num_threads()
    assert {"torch", "numpy", "scipy", "python"} <= set(facts["versions"])


def test_the_commit_of_a_checkout(tmp_path: Path) -> None:
    assert commit(tmp_path) is None
    (tmp_path / "a").write_text("1")
    who = ("-c", "user.name=a", "-c", "user.email=a@b")
    for command in (("init",), ("add", "a"), (*who, "commit", "-m", "a")):
        subprocess.run(("git", "-C", tmp_path, *command), check=True, capture_output=True)
    clean = commit(tmp_path)
    assert clean is not None and len(clean) == 12
    (tmp_path / "a").write_text("2")
    assert commit(tmp_path) == clean + "+"
