"""Threads for work that NumPy and PyTorch do outside of the interpreter's lock."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import CancelledError, ThreadPoolExecutor, as_completed
from contextlib import contextmanager
from threading import Event
from typing import TypeVar

import torch

T, R = TypeVar("T"), TypeVar("R")

# Items a thread that pay for its start.
LEAST_ITEMS = 4


@contextmanager
def cpu_threads(count: int) -> Iterator[None]:
    """Sets how many threads PyTorch uses, for a while."""
    before = torch.get_num_threads()
    torch.set_num_threads(count)
    try:
        yield
    finally:
        torch.set_num_threads(before)


def in_threads(work: Callable[[T], None], items: Sequence[T]) -> None:
    """Does independent work on all items, by as many threads as PyTorch may use.

    Raises:
        Exception: the first that `work` raised.
    """
    count = min(torch.get_num_threads(), len(items) // LEAST_ITEMS)
    if count < 2:
        for item in items:
            work(item)
        return

    def share(number: int) -> None:
        for item in items[number::count]:
            work(item)

    with ThreadPoolExecutor(count) as pool:
        for _ in pool.map(share, range(count)):
            pass  # raises what a thread raised


def side_by_side(
    work: Callable[[T, Event], R],
    items: Sequence[T],
    workers: int,
    threads: int,
    done: Callable[[T], None],
) -> list[R]:
    """The results of independent work on all items, in their order.

    Small operations leave most threads of PyTorch idle; several items at once do not.

    Args:
        work: on one item; gradients are recorded if they are here. The event is set once its result
            is not wanted any more: long work then raises CancelledError.
        items: all.
        workers: how many items at once.
        threads: of PyTorch for each of them.
        done: told each item when its work is done, in any order, by this thread.

    Raises:
        Exception: the first that `work` raised; what has not begun by then never does.
    """
    gradients, stopped = torch.is_grad_enabled(), Event()

    def alone(item: T) -> R:
        if stopped.is_set():
            raise CancelledError
        try:
            with torch.set_grad_enabled(gradients):
                return work(item, stopped)
        except BaseException:
            stopped.set()  # at once, whenever the main thread hears of it
            raise

    pool = ThreadPoolExecutor(workers)
    with cpu_threads(threads):  # for the workers, which begin later, too
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
