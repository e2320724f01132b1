"""The simulated accelerator, for every test that asks for `cuda`."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from spmm_torch.benchmark.launches.simulation import simulated_cuda
from spmm_torch.benchmark.launches.tally import Tally


@pytest.fixture
def cuda() -> Iterator[Tally]:
    """What the device is asked while the test runs on it."""
    with simulated_cuda() as tally:
        yield tally
