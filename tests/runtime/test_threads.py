"""Several items of work at once."""

from __future__ import annotations

import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from concurrent.futures import CancelledError
from threading import Event

import pytest
import torch

from spmm_torch.runtime.threads import cpu_threads, in_threads, side_by_side

THREADS = 4


@pytest.fixture(autouse=True)
def threads() -> Iterator[None]:
    with cpu_threads(THREADS):
        yield


def test_threads_are_put_back() -> None:
    before = torch.get_num_threads()
    with pytest.raises(KeyError), cpu_threads(1):
        assert torch.get_num_threads() == 1
        raise KeyError
    assert torch.get_num_threads() == before


@pytest.mark.parametrize("workers", [1, 2, 4])
def test_results_are_in_order_and_each_is_told_once(workers: int) -> None:
    def work(item: int, _: Event) -> int:
        time.sleep(0.002 * (5 - item))  # the first ends last
        return item * item

    told: list[int] = []
    assert side_by_side(work, range(5), workers, 1, told.append) == [0, 1, 4, 9, 16]
    assert sorted(told) == list(range(5))


def test_items_really_run_at_the_same_time() -> None:
    both = threading.Barrier(2, timeout=30.0)
    side_by_side(lambda *_: both.wait(), range(2), 2, 1, lambda _: None)


def test_workers_have_the_threads_asked_for_and_this_one_gets_its_own_back() -> None:
    found = side_by_side(lambda *_: torch.get_num_threads(), range(4), 2, 2, lambda _: None)
    assert found == [2, 2, 2, 2]
    assert torch.get_num_threads() == THREADS


@pytest.mark.parametrize("gradients", [True, False])
def test_gradients_are_as_they_are_here(gradients: bool) -> None:
    with torch.set_grad_enabled(gradients):
        found = side_by_side(lambda *_: torch.is_grad_enabled(), range(2), 2, 1, lambda _: None)
    assert found == [gradients, gradients]


def test_after_a_failure_nothing_begins() -> None:
    begun, told = [], []

    def work(item: int, _: Event) -> None:
        begun.append(item)
        if item == 2:
            raise ValueError("third")

    with pytest.raises(ValueError, match="third"):
        side_by_side(work, range(100), 1, 1, told.append)
    assert begun == [0, 1, 2]
    assert told == [0, 1]
    assert torch.get_num_threads() == THREADS


def test_an_interrupt_ends_what_looks_for_it() -> None:
    """The second item would go on for ever; Ctrl-C comes to this thread when the first is done."""

    def work(item: int, stopped: Event) -> None:
        if item:
            assert stopped.wait(30.0)
            raise CancelledError

    def interrupted(_: int) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        side_by_side(work, range(2), 2, 1, interrupted)


def test_in_threads_does_every_item_and_raises() -> None:
    done: list[int] = []
    in_threads(done.append, range(50))
    assert sorted(done) == list(range(50))

    def fail(item: int) -> None:
        raise ValueError(str(item))

    with pytest.raises(ValueError, match=r"\d"):
        in_threads(fail, range(50))


FORKED = """
import os
import torch
import spmm_torch.runtime.threads

torch.set_num_threads(2)
values = torch.rand(2000, 2000)
values.exp().sum(), values @ values
child = os.fork()
if child == 0:
    values.exp().sum(), values @ values
    os._exit(7)
assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 7
"""


def test_a_forked_child_does_not_wait_for_the_threads_of_its_parent() -> None:
    subprocess.run([sys.executable, "-c", FORKED], check=True, timeout=120)
