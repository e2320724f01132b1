"""The simulated accelerator, for every test that asks for `cuda`."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from tests.accelerator.simulation import simulated_cuda
from tests.accelerator.tally import Tally


@pytest.fixture
def cuda() -> Iterator[Tally]:
    """What the device is asked while the test runs on it."""
    with simulated_cuda() as tally:
        yield tally
