"""Threads for work that NumPy and PyTorch do without the interpreter's lock."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import CancelledError, ThreadPoolExecutor, as_completed
from contextlib import contextmanager
from threading import Event
from typing import TypeVar

import torch

# A forked child has none of the threads of its parent, and waits for them for ever.
if hasattr(os, "register_at_fork"):  # Windows has no forks
    os.register_at_fork(after_in_child=lambda: torch.set_num_threads(1))

T = TypeVar("T")
R = TypeVar("R")

# Items of a thread that outweigh the cost of its start.
MIN_ITEMS = 4


@contextmanager
def cpu_threads(count: int) -> Iterator[None]:
    """Lets PyTorch use `count` threads within the block under `with`."""
    before = torch.get_num_threads()
    torch.set_num_threads(count)
    try:
        yield
    finally:
        torch.set_num_threads(before)


def in_threads(work: Callable[[T], None], items: Sequence[T]) -> None:
    """Calls `work` on all items, which must be independent, in as many threads as PyTorch uses.

    Raises:
        Exception: the first one that `work` raised.
    """
    count = min(torch.get_num_threads(), len(items) // MIN_ITEMS)
    if count < 2:
        for item in items:
            work(item)
        return

    def work_on_part(number: int) -> None:
        for item in items[number::count]:
            work(item)

    with ThreadPoolExecutor(count) as pool:
        for _ in pool.map(work_on_part, range(count)):
            pass  # raises the exception of a thread


def side_by_side(
    work: Callable[[T, Event], R],
    items: Sequence[T],
    workers: int,
    threads: int,
    done: Callable[[T], None],
) -> list[R]:
    """The results of `work` on independent items, in their order.

    Several items run at once, because small operations leave most threads of PyTorch idle.

    Args:
        work: function of one item and an event; it records gradients if the caller does. The event
            is set when the result is no longer wanted: long work then raises CancelledError.
        items: all items.
        workers: number of items that run at once.
        threads: number of threads of PyTorch for each of them.
        done: called by this thread with each finished item, in any order.

    Raises:
        Exception: the first one that `work` raised; items that have not begun by then never do.
    """
    gradients, stopped = torch.is_grad_enabled(), Event()

    def alone(item: T) -> R:
        if stopped.is_set():
            raise CancelledError
        try:
            with torch.set_grad_enabled(gradients):
                return work(item, stopped)
        except BaseException:
            stopped.set()  # before the main thread sees the exception
            raise

    pool = ThreadPoolExecutor(workers)
    with cpu_threads(threads):  # holds for the workers, too, as they begin later
        try:
            futures = {pool.submit(alone, item): item for item in items}
            for future in as_completed(futures):
                if not isinstance(future.exception(), CancelledError):
                    future.result()
                    done(futures[future])
            return [future.result() for future in futures]
        finally:
            stopped.set()
            pool.shutdown(cancel_futures=True)
