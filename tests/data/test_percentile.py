"""The exact percentile against NumPy's."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from spmm_torch.data.percentile import percentile

VALUES = arrays(
    np.float32,
    st.integers(1, 200),
    elements=st.floats(0, 1e6, width=32) | st.sampled_from([0.0, -0.0, 0.5, 1.0]),
)


@settings(max_examples=40, deadline=None)
@given(VALUES, st.sampled_from([0.001, 0.5, 0.9, 0.999, 1.0]), st.sampled_from([64, 150, 200]))
def test_equals_numpy_whatever_the_chunk(values: np.ndarray, fraction: float, chunk: int) -> None:
    found = percentile(lambda: torch.from_numpy(values).split(chunk), fraction)
    # The rank is taken here because NumPy rounds fraction * n in its own way.
    rank = max(int(np.ceil(fraction * values.size)), 1)
    assert found == np.sort(values)[rank - 1]


def test_many_values() -> None:
    values = torch.rand(10**6, generator=torch.Generator().manual_seed(0)) * 30
    expected = np.percentile(values.numpy(), 99.9, method="inverted_cdf")
    assert percentile(lambda: values.split(300_000), 0.999) == pytest.approx(float(expected))
