"""Settings for all tests: reproducible examples, and GPU tests only where there is a GPU."""

from __future__ import annotations

import pytest
import torch
from hypothesis import settings

# Every run draws the same examples, and a busy machine fails none of them.
settings.register_profile("spmm_torch", derandomize=True, deadline=None, database=None)
settings.load_profile("spmm_torch")


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Skips tests marked `gpu` on machines without CUDA."""
    if torch.cuda.is_available():
        return
    skip = pytest.mark.skip(reason="needs CUDA")
    for item in items:
        if item.get_closest_marker("gpu"):
            item.add_marker(skip)
