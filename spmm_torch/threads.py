"""Threads for work that NumPy does outside of the interpreter's lock."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

import torch

T = TypeVar("T")

# Items a thread that pay for its start.
LEAST_ITEMS = 4


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
