"""Settings for all tests: reproducible examples, and a simulated GPU where there is none."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
import torch
from hypothesis import settings

# Every run draws the same examples, and a busy machine fails none of them.
settings.register_profile("spmm_torch", derandomize=True, deadline=None, database=None)
settings.load_profile("spmm_torch")


@pytest.fixture(autouse=True)
def gpu(request: pytest.FixtureRequest) -> Iterator[None]:
    """A simulated GPU for tests marked `gpu` where there is no other.

    Those marked `gpu(simulated=False)` are skipped there.
    """
    mark = request.node.get_closest_marker("gpu")
    if mark is None or torch.cuda.is_available():
        yield
        return
    if not mark.kwargs.get("simulated", True):
        pytest.skip("needs CUDA")
    from spmm_torch.benchmark.launches.simulation import simulated_cuda  # slow to load

    with simulated_cuda():
        yield
