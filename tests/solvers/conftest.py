"""One thread: these tensors are small, and threads that wait for a busy core only cost time."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from spmm_torch.runtime.threads import cpu_threads


@pytest.fixture(autouse=True)
def single_thread() -> Iterator[None]:
    with cpu_threads(1):
        yield
